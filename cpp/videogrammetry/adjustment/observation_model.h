#pragma once

#include <Eigen/Core>
#include <optional>

#include "videogrammetry/geometry/camera.h"
#include "videogrammetry/geometry/circle.h"
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

/// What a camera measures of a mark: Project(camera, outer * inner * point), or
/// of a circle the centre of its ellipse (ProjectEllipseCenter).
///
/// @param outer  nullptr = identity (by_outer is then left untouched).
/// @param mark  a point or circle of the object; radius_mm 0 = a point.
/// @return nullopt where the mark has no picture (see Project).
std::optional<Eigen::Vector2d> PredictImagePoint(const Camera& camera, const Rigid3* outer,
                                                 const Rigid3& inner, const Circle& mark,
                                                 ImagePointJacobians* jacobians = nullptr);

}  // namespace videogrammetry
