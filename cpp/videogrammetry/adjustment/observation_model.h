#pragma once

#include <Eigen/Core>
#include <optional>

#include "videogrammetry/geometry/camera.h"
#include "videogrammetry/geometry/rigid3.h"

namespace videogrammetry {

/// Derivatives of a predicted image point, px per unit of the unknown; poses
/// as (rotation vector on the left, shift), see NetworkPose.
struct ImagePointJacobians {
  Eigen::Matrix<double, 2, kNumInterior> by_interior;
  Eigen::Matrix<double, 2, 6> by_outer;
  Eigen::Matrix<double, 2, 6> by_inner;
  Eigen::Matrix<double, 2, 3> by_point;
};

/// Picture of an object point: Project(camera, outer * inner * point).
///
/// @param outer  nullptr = identity (by_outer is then left untouched).
/// @return nullopt where the point has no picture (see Project).
std::optional<Eigen::Vector2d> PredictImagePoint(const Camera& camera, const Rigid3* outer,
                                                 const Rigid3& inner,
                                                 const Eigen::Vector3d& point_mm,
                                                 ImagePointJacobians* jacobians = nullptr);

}  // namespace videogrammetry
