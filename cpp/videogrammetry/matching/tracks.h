#pragma once

#include <vector>

#include "videogrammetry/matching/view.h"

namespace videogrammetry {

/// A point followed over stages: position and velocity (mm a stage) with covariance.
struct TrackedPoint {
  int id = -1;
  double log_odds = 0.0;
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero(), velocity = Eigen::Vector3d::Zero();
  /// Covariance of position, of position and velocity, of velocity.
  Eigen::Matrix3d cov_pp = Eigen::Matrix3d::Zero(), cov_pv = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d cov_vv = Eigen::Matrix3d::Zero();
  double acceleration2 = 0.0;  ///< variance of the velocity's change in a stage, an axis
  bool has_velocity = false;
  bool by_user = false;
  int missed = 0;  ///< stages since it was last seen
  std::size_t last_stage = 0;
  std::vector<std::size_t> matches;  ///< in the order in which they were found

  void Begin(const PointEstimate& point);
  /// The second place, `stages` later: gives the velocity.
  void GiveVelocity(const PointEstimate& point, double stages);
  /// A stage on.
  void Predict();
  /// A new place at the predicted stage.
  void Update(const PointEstimate& point);
};

}  // namespace videogrammetry
