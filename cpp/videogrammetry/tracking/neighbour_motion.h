#pragma once

#include <span>
#include <vector>

#include "videogrammetry/geometry/rigid3.h"
#include "videogrammetry/tracking/point_index.h"

namespace videogrammetry {

/// Weighted best-fit motion after_from_before (Kabsch) and its RMS a coordinate,
/// which counts the six unknowns.
struct FittedMotion {
  Rigid3 motion;
  double rms_mm = 0.0;
};
FittedMotion FitMotion(std::span<const Eigen::Vector3d> after_mm,
                       std::span<const Eigen::Vector3d> before_mm, std::span<const double> weight);

/// The motion of a body between two stages as its identified points show it, for
/// the points between them.
///
/// Where one rigid motion fits all within 5 of their standard deviations, it is
/// that. Where the object bends, a place follows the rigid motion of the nearest
/// points, the nearer the heavier; how far that misses is measured by leaving
/// identified points out one by one.
class NeighbourMotion {
 public:
  struct Place {
    Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
    double variance_mm2 = 0.0;  ///< a coordinate, of the motion alone
  };

  static constexpr int kLeastPoints = 4;  // three fix a rigid motion, the fourth checks it

  /// @param before_mm, after_mm  at least kLeastPoints identified points at both stages.
  /// @param noise_mm  standard deviation of a coordinate's difference between both.
  /// @param neighbours  lie within the weight's reach where the object bends.
  NeighbourMotion(std::vector<Eigen::Vector3d> before_mm, std::vector<Eigen::Vector3d> after_mm,
                  double noise_mm, int neighbours);

  bool rigid() const { return rigid_; }
  Place Move(const Eigen::Vector3d& before_mm) const;

 private:
  FittedMotion FitAll() const;
  double LeaveOut() const;
  Eigen::Vector3d MoveLocally(const Eigen::Vector3d& before_mm, int left_out) const;

  std::vector<Eigen::Vector3d> before_, after_;
  double noise_mm_ = 0.0;
  int neighbours_ = 6;
  bool rigid_ = false;
  Rigid3 motion_;
  Eigen::Vector3d mean_ = Eigen::Vector3d::Zero();
  double spread2_ = 0.0;
  mutable double variance_ = -1.0;  // < 0: not known yet
  mutable PointIndex index_;
};

}  // namespace videogrammetry
