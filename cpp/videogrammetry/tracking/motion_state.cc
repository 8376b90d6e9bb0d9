#include "videogrammetry/tracking/motion_state.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <numbers>

namespace videogrammetry {

MotionState StartState(const Eigen::Vector3d& position_mm, const Eigen::Matrix3d& cov_mm2,
                       const Eigen::Vector3d& velocity_mm, const Eigen::Matrix3d& velocity_cov,
                       const MotionModel& model) {
  MotionState state;
  state.mean.head<3>() = position_mm;
  state.mean.segment<3>(3) = velocity_mm;
  state.cov.topLeftCorner<3, 3>() = cov_mm2;
  state.cov.block<3, 3>(3, 3) = velocity_cov;
  state.cov.bottomRightCorner<3, 3>().diagonal().setConstant(model.acceleration_var);
  return state;
}

MotionState Predict(const MotionState& state, const MotionModel& model) {
  const double rho = model.correlation;
  MotionState next;
  const auto x = state.mean.head<3>(), v = state.mean.segment<3>(3), a = state.mean.tail<3>();
  next.mean << x + v + 0.5 * a, v + a, rho * a;
  // F P F' by blocks: F's are multiples of the unit matrix.
  Matrix9d left;
  left.topRows<3>() =
      state.cov.topRows<3>() + state.cov.middleRows<3>(3) + 0.5 * state.cov.bottomRows<3>();
  left.middleRows<3>(3) = state.cov.middleRows<3>(3) + state.cov.bottomRows<3>();
  left.bottomRows<3>() = rho * state.cov.bottomRows<3>();
  next.cov.leftCols<3>() = left.leftCols<3>() + left.middleCols<3>(3) + 0.5 * left.rightCols<3>();
  next.cov.middleCols<3>(3) = left.middleCols<3>(3) + left.rightCols<3>();
  next.cov.rightCols<3>() = rho * left.rightCols<3>();
  next.cov.diagonal().tail<3>().array() += model.acceleration_var * (1.0 - rho * rho);
  return next;
}

MotionState Update(const MotionState& predicted, const Eigen::Vector3d& position_mm,
                   const Eigen::Matrix3d& cov_mm2) {
  const Eigen::Matrix3d inverse = (predicted.cov.topLeftCorner<3, 3>() + cov_mm2).eval().inverse();
  // lazyProduct: too small for the blocked product.
  const Eigen::Matrix<double, 9, 3> gain = predicted.cov.leftCols<3>().lazyProduct(inverse);
  MotionState state;
  state.mean = predicted.mean + gain * (position_mm - predicted.mean.head<3>());
  state.cov = predicted.cov - gain.lazyProduct(predicted.cov.topRows<3>());
  state.cov = 0.5 * (state.cov + state.cov.transpose()).eval();
  return state;
}

Innovation Compare(const Eigen::Vector3d& difference, const Eigen::Matrix3d& cov) {
  Eigen::Matrix3d inverse;
  double determinant = 0.0;
  bool invertible = false;
  cov.computeInverseAndDetWithCheck(inverse, determinant, invertible, 0.0);
  if (!invertible || !(determinant > 0)) {
    return {std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  }
  const double d2 = difference.dot(inverse * difference);
  return {d2, -0.5 * (d2 + std::log(determinant) + 3.0 * std::log(2.0 * std::numbers::pi))};
}

}  // namespace videogrammetry
