#pragma once

#include <Eigen/Core>
#include <optional>

#include "videogrammetry/adjustment/network.h"
#include "videogrammetry/geometry/camera.h"
#include "videogrammetry/geometry/circle.h"
#include "videogrammetry/geometry/refraction.h"
#include "videogrammetry/geometry/rigid3.h"

namespace videogrammetry {

/// Derivatives of a predicted image point, px per unit of the unknown; poses
/// as (rotation vector on the left, shift), see NetworkPose.
struct ImagePointJacobians {
  Eigen::Matrix<double, 2, kNumCameraUnknowns> by_camera;
  Eigen::Matrix<double, 2, 6> by_outer;
  Eigen::Matrix<double, 2, 6> by_inner;
  Eigen::Matrix<double, 2, 3> by_point;
  /// By a window's normal and distance; zero without one.
  Eigen::Matrix<double, 2, 3> by_normal = Eigen::Matrix<double, 2, 3>::Zero();
  Eigen::Vector2d by_distance = Eigen::Vector2d::Zero();
};

/// What lies between the lens' picture (x, y) and the pixel that is measured.
///
/// Pixels that are (1 + aspect) times as high as wide are counted from the
/// principal point's row c_y, before the distortion (its polynomial is a
/// function of lengths in pixel widths), and a point that moves by velocity_px
/// from picture to picture is met time_offset of that interval later:
///   pixel = (x, c_y + (y - c_y) / (1 + aspect)) + time_offset velocity_px.
struct Sampling {
  double aspect = 0.0;
  double time_offset = 0.0;
  Eigen::Vector2d velocity_px = Eigen::Vector2d::Zero();
};

/// What a camera measures of a mark: Project(camera, outer * inner * point), or
/// of a circle the centre of its ellipse (ProjectEllipseCenter); then Sampling.
///
/// @param outer  nullptr = identity (by_outer is then left untouched).
/// @param mark  a point or circle of the object; radius_mm 0 = a point.
/// @param interface  a window that the camera looks through (SeenThrough), in
///     the frame that `outer` leads from, without an outer pose in that of the
///     object; nullptr = none. Circles are not modelled through one: they
///     count as points.
/// @return nullopt where the mark has no picture (see Project).
std::optional<Eigen::Vector2d> PredictImagePoint(const Camera& camera, const Rigid3* outer,
                                                 const Rigid3& inner, const Circle& mark,
                                                 const Sampling& sampling = {},
                                                 ImagePointJacobians* jacobians = nullptr,
                                                 const FlatInterface* interface = nullptr);

/// What a measured point's residual is to be counted from, where it is the
/// corrected point that is observed with the stated covariance:
///   xy - r,  r = (u(xy) - u(predicted)) / (k (1 + aspect)),
/// u(.) the ideal point (px of the width from the principal point) of a pixel,
/// k = 1 - A1 r0^2 - A2 r0^4 - A3 r0^6 its scale in the middle, so that r does
/// not depend on r0. Both coordinates of r are lengths in pixel heights. Of a point
/// u(predicted) = f (X, Y) / Z: the residual of DBAT's adjustment, whose polynomial
/// without r0 is u / k and which holds the pixel's height and estimates its width.
///
/// @param pixel, jacobians  of PredictImagePoint; changed. `has_outer`: whether
///     by_outer has been written.
void CountFromCorrected(const Camera& camera, const Sampling& sampling,
                        const Eigen::Vector2d& xy_px, bool has_outer, Eigen::Vector2d* pixel,
                        ImagePointJacobians* jacobians = nullptr);

/// What an observation's residual is counted from: PredictImagePoint, of cameras with
/// `corrected_residual` CountFromCorrected.
std::optional<Eigen::Vector2d> PredictObservation(const Network& network,
                                                  const NetworkObservation& observation,
                                                  ImagePointJacobians* jacobians = nullptr);

/// The picture of a point in an image of the network.
std::optional<Eigen::Vector2d> PredictImagePoint(const Network& network, int image, int point,
                                                 const Eigen::Vector2d& velocity_px,
                                                 ImagePointJacobians* jacobians = nullptr);

}  // namespace videogrammetry
