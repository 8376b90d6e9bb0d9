#pragma once

#include <optional>
#include <span>

#include "videogrammetry/geometry/circle.h"
#include "videogrammetry/geometry/conic.h"
#include "videogrammetry/geometry/rig.h"

namespace videogrammetry {

/// One camera's ellipse of a circle.
struct EllipseSighting {
  int camera = 0;
  Ellipse ellipse;
  /// Covariance of semi-major, semi-minor axis and angle (px, px, rad).
  Eigen::Matrix3d cov = Eigen::Matrix3d::Identity();
};

/// A circle's normal, from the shapes of its pictures.
struct NormalEstimate {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< unit, towards the cameras
  Eigen::Matrix3d cov = Eigen::Matrix3d::Zero();      ///< rank 2: cov * normal = 0
  double radius_mm = 0.0;                             ///< from the ellipses' sizes
  double chi2 = 0.0;                                  ///< of the shapes, 3 n - 3 degrees of freedom
};

/// How far the normal may turn from the mean line of sight before anything is
/// seen of the ellipses: a standard deviation per axis, rad. Circles that are
/// seen at all face the cameras within 60 to 70 degrees.
inline constexpr double kNormalPriorRad = 0.7;

/// Estimates a circle's normal from its ellipses in one or more cameras.
///
/// Least squares over the shapes (S_xx, S_xy, S_yy) of all ellipses, taken to
/// the plane z = 1 through the distortion's slope, with the normal and the
/// radius unknown: the radius is free, so that a diameter stated wrong, or
/// edges all a little outside, does not turn the normal. S is a smooth function
/// of the ellipse also where it is round and its angle means nothing. A prior
/// of kNormalPriorRad about the mean line of sight bounds what nothing else does.
///
/// One ellipse allows two normals, mirrored about the line of sight. The start
/// is the one of all cameras' pairs that fits best; its mirror image is
/// followed too, and where the shapes do not decide between the two minima,
/// mean and covariance are those of both together, weighted by exp(-chi2 / 2).
/// Where the circle is seen so squarely that its tilt shows in second order
/// only, the derivatives are averaged over the tilt's own uncertainty. A chi2
/// above its expectation enlarges the covariance.
///
/// @param position  the circle's centre in the world frame.
/// @return nullopt if no ellipse is usable (not finite, flat, no covariance, or
///     the position behind its camera).
std::optional<NormalEstimate> EstimateNormal(const Rig& rig,
                                             std::span<const EllipseSighting> sightings,
                                             const Eigen::Vector3d& position);

/// Two unit vectors that span the plane across `normal`, as columns.
Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& normal);

}  // namespace videogrammetry
