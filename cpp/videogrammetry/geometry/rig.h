#pragma once

#include <optional>
#include <vector>

#include "videogrammetry/geometry/camera.h"
#include "videogrammetry/geometry/refraction.h"
#include "videogrammetry/geometry/rigid3.h"

namespace videogrammetry {

/// A camera with its exterior orientation: x_in_cam = cam_from_world * x_in_world,
/// and the window through which it looks, if there is one, in the world's frame.
struct OrientedCamera {
  Camera camera;
  Rigid3 cam_from_world;
  std::optional<FlatInterface> interface = std::nullopt;

  Eigen::Vector3d center_in_world() const {
    return -(cam_from_world.rotation.transpose() * cam_from_world.translation_mm);
  }
};

/// The cameras of a rig, in the project's order; their number is data.
using Rig = std::vector<OrientedCamera>;

/// Order of a camera's sixteen parameters in derivatives and covariances: the
/// ten of InteriorIndex, then the rotation vector applied on the LEFT of
/// cam_from_world (rad), then the translation (mm).
inline constexpr int kNumCameraParameters = kNumInterior + 6;

/// Derivatives of a picture by the world point and by the camera's sixteen parameters
/// (a window being held).
struct OrientedJacobians {
  Eigen::Matrix<double, 2, 3> by_point;
  Eigen::Matrix<double, 2, kNumCameraParameters> by_camera;
};

/// Picture of a point of the world frame, seen through the camera's window
/// (SeenThrough); nullopt as Project, or with the camera behind its window.
std::optional<Eigen::Vector2d> ProjectFromWorld(const OrientedCamera& oriented,
                                                const Eigen::Vector3d& point_in_world,
                                                OrientedJacobians* jacobians = nullptr);

/// The same with all derivatives; `near_px` is about where the picture is.
std::optional<Eigen::Vector2d> ProjectFromWorld(const OrientedCamera& oriented,
                                                const Eigen::Vector3d& point_in_world,
                                                const Eigen::Vector2d& near_px,
                                                OrientedJacobians* jacobians);

/// The same with the derivative by the point alone, three times as fast. `near_px` is
/// about where the picture is: the search for it begins there.
std::optional<Eigen::Vector2d> ProjectFromWorld(const OrientedCamera& oriented,
                                                const Eigen::Vector3d& point_in_world,
                                                const Eigen::Vector2d& near_px,
                                                Eigen::Matrix<double, 2, 3>* by_point);

/// The ray of the world frame through a pixel, behind a window the refracted
/// one; `direction_by_pixel` and `origin_by_pixel` get its derivatives.
/// @return nullopt as RayThroughPixel, or if the ray misses the window's plane.
std::optional<Ray> RayFromPixel(const OrientedCamera& oriented, const Eigen::Vector2d& pixel,
                                Eigen::Matrix<double, 3, 2>* direction_by_pixel = nullptr,
                                Eigen::Matrix<double, 3, 2>* origin_by_pixel = nullptr);

}  // namespace videogrammetry
