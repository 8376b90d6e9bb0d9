#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "videogrammetry/geometry/intersection.h"

namespace videogrammetry {

/// Matches as flat arrays: point i has the sightings [offsets[i], offsets[i+1]).
struct MatchArrays {
  std::span<const std::int64_t> offsets;  ///< P + 1, ascending, offsets[0] = 0
  std::span<const std::int32_t> camera;   ///< index into the rig
  const double* xy_px = nullptr;          ///< (M, 2)
  const double* cov_px2 = nullptr;        ///< (M, 3): xx, xy, yy
};

/// Options of the reconstruction.
struct TriangulationOptions {
  int num_threads = 1;  ///< 0: one a core
};

/// Points with covariance; a failed point keeps NaN and its status.
struct TriangulatedPoints {
  std::vector<double> position_mm;   ///< (P, 3)
  std::vector<double> cov_image;     ///< (P, 3, 3) mm^2, from the image noise
  std::vector<double> cov_rig;       ///< (P, 3, 3) mm^2, from the calibration; 0 without one
  std::vector<double> chi2;          ///< (P), 2n - 3 degrees of freedom
  std::vector<double> convergence_rad;  ///< (P)
  std::vector<double> residual_px;   ///< (M, 2) measured - adjusted
  std::vector<std::uint8_t> status;  ///< (P) IntersectionStatus
};

/// Triangulates many points with the cameras' orientation held.
///
/// Two covariances per point: cov_image = (J^T W J)^-1, and the calibration's
/// part G C G^T with G = -(J^T W J)^-1 J^T W A, A the derivatives of the
/// pictures by the cameras' parameters and C their covariance. Errors of the
/// calibration are common to all points of a rig; cov_rig is the part of one
/// point alone.
///
/// @param cov_rig  covariance of all cameras' parameters, (16 K, 16 K), ordered
///     camera by camera as kNumCameraParameters says; or 0 rows for none.
/// @throws std::invalid_argument on inconsistent sizes or a camera index out of range.
TriangulatedPoints Triangulate(const Rig& rig, const MatchArrays& matches,
                               const Eigen::Ref<const Eigen::MatrixXd>& cov_rig,
                               const TriangulationOptions& options = {});

}  // namespace videogrammetry
