#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "videogrammetry/geometry/rig.h"

namespace videogrammetry {

/// Residuals of the points of K looks, those of look k being [offsets[k], offsets[k + 1]).
struct LookResiduals {
  std::span<const std::int64_t> offsets;  ///< K + 1, ascending, offsets[0] = 0
  const double* position_mm = nullptr;    ///< (P, 3) where the residuals were computed
  const double* residual_px = nullptr;    ///< (P, C, 2) measured - computed; NaN: not seen
  const double* variance_px2 = nullptr;   ///< (P, C, 2) of the measured coordinates
  const double* cov_mm2 = nullptr;        ///< (P, 3, 3) of known points; null: not known
  /// F (16 C, R), row-major: what R independent errors do to the cameras' parameters.
  const double* factor = nullptr;
  std::size_t rank = 0;  ///< R
};

/// What residuals say of the six pose parameters of all cameras: a turn about the projection
/// centre (rotation vector on the left of cam_from_world, rad), a shift of that centre in the
/// rig's frame (mm).
struct PoseScores {
  std::vector<double> normal;  ///< (K, 6 C, 6 C) N = B'W P B
  std::vector<double> score;   ///< (K, 6 C) g = B'W P r
  std::vector<double> chi2;    ///< (K, C) r'W P r; of points that are not known of all cameras
  std::vector<double> by_calibration;  ///< (K, 6 C, R) B'W P A F
};

/// Sums over the points of every look.
///
/// J, A the derivatives of the pictures by point and cameras, B those by the poses. Points that
/// are not known are eliminated, P = I - J (J'WJ)^-1 J'W; for known ones P = I and
/// W = (C_px + J C_X J')^-1.
PoseScores SumPoseScores(const Rig& rig, const LookResiduals& residuals);

}  // namespace videogrammetry
