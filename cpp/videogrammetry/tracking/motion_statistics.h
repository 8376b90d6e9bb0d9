#pragma once

#include <array>

#include "videogrammetry/tracking/motion_state.h"

namespace videogrammetry {

/// Learns the accelerations' variance and correlation from the points themselves.
///
/// With the model of MotionState, the second and third differences of true
/// positions at successive stages are (a1 + a0) / 2 and (a2 - a0) / 2, so that
/// their variances per coordinate are
///
///     V2 = s^2 (1 + rho) / 2,   V3 = s^2 (1 - rho^2) / 2,   1 - rho = V3 / V2;
///
/// the noise sigma^2 of the positions adds 6 and 20 sigma^2 to them, and what is
/// left is known no better than the noise's own scatter over the samples: V3 and
/// V2 are not taken below that. Older samples are forgotten, one alone never
/// counts as more than `kClip` times the variance so far.
class MotionStatistics {
 public:
  /// Until `kPrior` samples are there, accelerations of this size are expected.
  explicit MotionStatistics(double prior_acceleration_mm = 0.0);

  /// Positions of one point at successive stages, the newest first, with noise
  /// variances per coordinate; 3 of them, or 4 if `has_fourth`.
  void Add(const std::array<Eigen::Vector3d, 4>& position_mm,
           const std::array<double, 4>& variance_mm2, bool has_fourth);
  /// To be called once a stage: takes what Add gathered.
  void Commit();

  MotionModel model() const { return model_; }
  double second_difference_var() const { return second_.signal; }
  double third_difference_var() const { return third_.signal; }
  double samples() const { return second_.count; }
  bool prepared() const { return prepared_; }

 private:
  struct Moment {
    double sum = 0.0, noise_sum = 0.0;  // of this stage
    int added = 0;
    double total = 0.0, noise = 0.0, count = 0.0;  // means over the past
    double signal = 0.0;
    void Take(double squared, double noise_var);
    void Commit(double memory);
  };
  void Refresh();

  bool prepared_ = false;
  Moment second_, third_;
  MotionModel model_;
};

}  // namespace videogrammetry
