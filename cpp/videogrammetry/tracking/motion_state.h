#pragma once

#include <Eigen/Core>
#include <cmath>

namespace videogrammetry {

using Vector9d = Eigen::Matrix<double, 9, 1>;
using Matrix9d = Eigen::Matrix<double, 9, 9>;

/// How points accelerate: a first-order Gauss-Markov acceleration, alike in all
/// directions (Singer [1]), in units of a stage:
///
///     x' = x + v + a / 2,   v' = v + a,   a' = rho a + w,   var w = s^2 (1 - rho^2)
///
/// rho = 0: constant velocity but for an acceleration that is new in every stage;
/// rho -> 1: constant acceleration.
///
/// [1] R. A. Singer, Estimating optimal tracking filter performance for manned
///     maneuvering targets, IEEE Trans. AES 6 (1970), 473-483.
struct MotionModel {
  double acceleration_var = 1.0;  ///< s^2 per coordinate, mm^2 / stage^4
  double correlation = 0.0;       ///< rho, [0, 1)
};

/// Position, velocity and acceleration (mm, stages) of a point with covariance.
struct MotionState {
  Vector9d mean = Vector9d::Zero();
  Matrix9d cov = Matrix9d::Zero();

  Eigen::Vector3d position_mm() const { return mean.head<3>(); }
  Eigen::Vector3d velocity_mm() const { return mean.segment<3>(3); }
  Eigen::Matrix3d position_cov_mm2() const { return cov.topLeftCorner<3, 3>(); }
  /// Standard deviation of a coordinate, mean of the three.
  double deviation_mm() const { return std::sqrt(position_cov_mm2().trace() / 3.0); }
};

/// A point seen once: its velocity is `velocity_mm` a stage within `velocity_cov`.
MotionState StartState(const Eigen::Vector3d& position_mm, const Eigen::Matrix3d& cov_mm2,
                       const Eigen::Vector3d& velocity_mm, const Eigen::Matrix3d& velocity_cov,
                       const MotionModel& model);

/// The state one stage later.
MotionState Predict(const MotionState& state, const MotionModel& model);

/// The state after a measured position (Kalman's update, covariance kept symmetric).
MotionState Update(const MotionState& predicted, const Eigen::Vector3d& position_mm,
                   const Eigen::Matrix3d& cov_mm2);

/// d^2 = e' S^-1 e and the logarithm of the density N(e; 0, S).
struct Innovation {
  double distance2 = 0.0;
  double log_density = 0.0;
};
Innovation Compare(const Eigen::Vector3d& difference, const Eigen::Matrix3d& cov);

}  // namespace videogrammetry
