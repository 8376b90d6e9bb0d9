#pragma once

#include <vector>

#include "videogrammetry/geometry/camera.h"
#include "videogrammetry/geometry/rigid3.h"

namespace videogrammetry {

/// A camera with its exterior orientation: x_in_cam = cam_from_world * x_in_world.
struct OrientedCamera {
  Camera camera;
  Rigid3 cam_from_world;

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

/// Derivatives of a picture by the world point and by the camera's sixteen parameters.
struct OrientedJacobians {
  Eigen::Matrix<double, 2, 3> by_point;
  Eigen::Matrix<double, 2, kNumCameraParameters> by_camera;
};

/// Picture of a point of the world frame; nullopt as Project.
std::optional<Eigen::Vector2d> ProjectFromWorld(const OrientedCamera& oriented,
                                                const Eigen::Vector3d& point_in_world,
                                                OrientedJacobians* jacobians = nullptr);

}  // namespace videogrammetry
