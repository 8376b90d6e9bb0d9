#include "videogrammetry/matching/tracks.h"

#include <Eigen/LU>
#include <algorithm>

namespace videogrammetry {
namespace {

// Velocities change by this share of themselves in a stage, before anything is known.
constexpr double kFirstChange = 0.1;
// Weight of a stage's innovation in the estimate of the acceleration.
constexpr double kMemory = 0.2;

}  // namespace

void TrackedPoint::Begin(const PointEstimate& point) {
  position_mm = point.position_mm;
  cov_pp = point.cov_mm2();
  velocity.setZero();
  has_velocity = false;
}

void TrackedPoint::GiveVelocity(const PointEstimate& point, double stages) {
  const Eigen::Matrix3d cov = point.cov_mm2();
  velocity = (point.position_mm - position_mm) / stages;
  acceleration2 = kFirstChange * kFirstChange * velocity.squaredNorm() / 3 + cov.trace() / 3;
  cov_vv = (cov + cov_pp) / (stages * stages) + acceleration2 * Eigen::Matrix3d::Identity();
  cov_pv = cov / stages;
  cov_pp = cov;
  position_mm = point.position_mm;
  has_velocity = true;
}

void TrackedPoint::Predict() {
  position_mm += velocity;
  cov_pp += cov_pv + cov_pv.transpose() + cov_vv;
  cov_pv += cov_vv;
  cov_pp.diagonal().array() += 0.25 * acceleration2;
  cov_pv.diagonal().array() += 0.5 * acceleration2;
  cov_vv.diagonal().array() += acceleration2;
}

void TrackedPoint::Update(const PointEstimate& point) {
  const Eigen::Matrix3d noise = point.cov_mm2();
  const Eigen::Vector3d innovation = point.position_mm - position_mm;
  const Eigen::Matrix3d inverse = (cov_pp + noise).inverse();
  const Eigen::Matrix3d gain_p = cov_pp * inverse;
  const Eigen::Matrix3d gain_v = cov_pv.transpose() * inverse;
  position_mm += gain_p * innovation;
  velocity += gain_v * innovation;
  cov_vv -= gain_v * cov_pv;
  cov_pv -= gain_p * cov_pv;
  cov_pp -= gain_p * cov_pp;
  cov_pp = (0.5 * (cov_pp + cov_pp.transpose())).eval();
  cov_vv = (0.5 * (cov_vv + cov_vv.transpose())).eval();
  const double excess = (innovation.squaredNorm() - noise.trace()) / 3;
  acceleration2 =
      std::max((1 - kMemory) * acceleration2 + kMemory * excess, 1e-4 * noise.trace() / 3);
}

}  // namespace videogrammetry
