#pragma once

#include <span>
#include <vector>

#include "videogrammetry/reconstruction/triangulate.h"

namespace videogrammetry {

/// One point's circle, as CircleArrays has it.
struct MeasuredCircle {
  double diameter_mm = 0.0;  ///< NaN: not known, nothing is corrected
  double thickness_mm = 0.0;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  ///< NaN: not known
  Eigen::Matrix3d cov_normal = Eigen::Matrix3d::Zero();
  std::vector<EllipseSighting> ellipses;
};

/// What an intersection that knows of the circle adds.
struct CircleIntersection {
  CircleStatus status = CircleStatus::kNone;
  Eigen::Vector3d normal;      ///< NaN: none
  Eigen::Matrix3d cov_normal;  ///< NaN: none
  Eigen::Matrix3d cov_mm2;     ///< of the moved point, the normal's part included
  Eigen::Vector3d moved_mm = Eigen::Vector3d::Zero();  ///< -thickness along the normal
  std::vector<Eigen::Vector2d> offsets_px;             ///< one a sighting

  CircleIntersection();
};

/// @throws std::invalid_argument as Triangulate.
void CheckCircles(const CircleArrays& circles, std::size_t num_points);

/// Point `i`, whose sightings begin at `begin`, of the arrays.
MeasuredCircle CircleOf(const CircleArrays& circles, std::size_t i, std::size_t begin,
                        std::span<const Sighting> sightings);

/// Improves the intersection `point` of the ellipses' centres to that of the
/// circle's centre; see Triangulate. `point` keeps the covariance of exact
/// normals; `result->cov_mm2` is the whole one.
///
/// @return kNoNormal where a thickness is to be taken off and no normal is to be had.
IntersectionStatus IntersectCircle(const Rig& rig, std::span<const Sighting> sightings,
                                   const MeasuredCircle& circle, Intersection* point,
                                   CircleIntersection* result);

}  // namespace videogrammetry
