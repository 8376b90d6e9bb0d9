#pragma once

#include <span>
#include <vector>

#include "videogrammetry/geometry/rig.h"

namespace videogrammetry {

/// One sighting of a point: which camera, where, how surely.
struct Sighting {
  int camera = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Matrix2d cov_px2 = Eigen::Matrix2d::Identity();
};

/// A point intersected from two or more sightings.
struct Intersection {
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  Eigen::Matrix3d cov_mm2 = Eigen::Matrix3d::Zero();  ///< from cov_px2 alone
  double chi2 = 0.0;             ///< weighted squared residuals; 2n - 3 degrees of freedom
  double convergence_rad = 0.0;  ///< largest angle between two of the rays
  std::vector<Eigen::Vector2d> residuals_px;  ///< measured - adjusted, one a sighting
};

/// Why an intersection failed.
enum class IntersectionStatus {
  kOk,
  kTooFewRays,    ///< fewer than two sightings
  kParallelRays,  ///< no angle between any two rays: depth is not determined
  kBehindCamera,  ///< the rays meet behind a camera
  kNotConverged,
  kNoNormal  ///< a sticker's thickness is to be taken off, but no ellipse says its normal
};

/// Intersects the rays of n sightings by least squares of the image residuals.
///
/// Start: the point nearest to all rays, sum |(I - u u^T)(X - C)|^2 = min.
/// Then Gauss-Newton on the residuals in the measured picture, weighted with
/// cov_px2^-1; cov_mm2 = (J^T W J)^-1. An intersection of two rays costs about
/// a microsecond.
///
/// @param result  left untouched on failure.
IntersectionStatus Intersect(const Rig& rig, std::span<const Sighting> sightings,
                             Intersection* result);

}  // namespace videogrammetry
