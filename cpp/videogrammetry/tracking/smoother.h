#pragma once

#include <span>
#include <vector>

#include "videogrammetry/tracking/motion_state.h"

namespace videogrammetry {

/// Positions of P points over S stages, stage by stage.
struct PointTable {
  std::size_t stages = 0, points = 0;
  std::vector<Eigen::Vector3d> position_mm;  ///< s * points + p
  std::vector<Eigen::Matrix3d> cov_mm2;      ///< of the image noise
  std::vector<char> seen;

  std::size_t at(std::size_t s, std::size_t p) const { return s * points + p; }
};

/// Options of filling gaps.
struct FillOptions {
  int largest_gap = 10;  ///< stages without the point; longer gaps stay. Range >= 0.
  int neighbours = 6;    ///< as in LinkOptions
};

/// The accelerations of all points of a table (MotionStatistics).
MotionModel LearnMotion(const PointTable& table);

/// One point's positions given its measurements before and after: Kalman's filter
/// and the backward pass of Rauch, Tung and Striebel [1],
///     C = P_k F' P_{k+1|k}^-1,  x_k^s = x_k + C (x_{k+1}^s - F x_k),
///     P_k^s = P_k + C (P_{k+1}^s - P_{k+1|k}) C'.
///
/// @param seen  per stage; the first is.
///
/// [1] H. E. Rauch, F. Tung, C. T. Striebel, Maximum likelihood estimates of linear
///     dynamic systems, AIAA Journal 3 (1965), 1445-1450.
std::vector<MotionState> SmoothPath(std::span<const Eigen::Vector3d> position_mm,
                                    std::span<const Eigen::Matrix3d> cov_mm2,
                                    std::span<const char> seen, const MotionModel& model);

/// Fills gaps of at most `largest_gap` stages between two stages that saw the
/// point: by the smoother, or by the motion of the points around it from the
/// gap's both ends (NeighbourMotion), whichever has the smaller covariance.
/// Measured positions stay. The smoother's covariance is multiplied by what gaps
/// of that length, cut into what was seen, show it to be too small or too large.
///
/// @return mask of what was filled, as `seen`.
/// @throws std::invalid_argument if sizes differ or an option is out of range.
std::vector<char> FillGaps(PointTable* table, const FillOptions& options);

}  // namespace videogrammetry
