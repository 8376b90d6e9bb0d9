#include "videogrammetry/tracking/neighbour_motion.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace videogrammetry {
namespace {

constexpr double kRigidWithin = 5.0;       // standard deviations of the points' noise
constexpr int kReach = 4;                  // times the neighbours have a part in a local motion
constexpr std::size_t kEnoughToTell = 64;  // points that show a motion not to be rigid
constexpr int kLeftOut = 24;               // points that are left out one by one

}  // namespace

FittedMotion FitMotion(std::span<const Eigen::Vector3d> after_mm,
                       std::span<const Eigen::Vector3d> before_mm, std::span<const double> weight) {
  Eigen::Vector3d mean_after = Eigen::Vector3d::Zero(), mean_before = mean_after;
  double total = 0.0;
  for (std::size_t i = 0; i < weight.size(); ++i) {
    mean_after += weight[i] * after_mm[i];
    mean_before += weight[i] * before_mm[i];
    total += weight[i];
  }
  mean_after /= total;
  mean_before /= total;
  Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < weight.size(); ++i) {
    correlation +=
        (weight[i] / total) * (after_mm[i] - mean_after) * (before_mm[i] - mean_before).transpose();
  }
  FittedMotion fit;
  fit.motion.rotation = NearestRotation(correlation);
  fit.motion.translation_mm = mean_after - fit.motion.rotation * mean_before;
  double squares = 0.0;
  for (std::size_t i = 0; i < weight.size(); ++i) {
    squares += weight[i] * (after_mm[i] - fit.motion * before_mm[i]).squaredNorm();
  }
  const double n = static_cast<double>(weight.size());
  fit.rms_mm = std::sqrt(squares * n / total / std::max(3.0 * n - 6.0, 1.0));
  return fit;
}

NeighbourMotion::NeighbourMotion(std::vector<Eigen::Vector3d> before_mm,
                                 std::vector<Eigen::Vector3d> after_mm, double noise_mm,
                                 int neighbours)
    : before_(std::move(before_mm)),
      after_(std::move(after_mm)),
      noise_mm_(noise_mm),
      neighbours_(neighbours) {
  const FittedMotion fit = FitAll();
  rigid_ = fit.rms_mm < kRigidWithin * noise_mm;
  if (rigid_) {
    motion_ = fit.motion;
    const double n = static_cast<double>(before_.size());
    for (const auto& x : before_) mean_ += x / n;
    for (const auto& x : before_) spread2_ += (x - mean_).squaredNorm() / 3.0;
    const double rms = std::max(fit.rms_mm, noise_mm);
    variance_ = rms * rms;
    return;
  }
}

FittedMotion NeighbourMotion::FitAll() const {
  const std::vector<double> weight(before_.size(), 1.0);
  const std::size_t step = before_.size() / kEnoughToTell;
  if (step >= 2) {
    std::vector<Eigen::Vector3d> before, after;
    for (std::size_t i = 0; i < before_.size(); i += step) {
      before.push_back(before_[i]);
      after.push_back(after_[i]);
    }
    const FittedMotion some = FitMotion(after, before, std::span(weight).first(before.size()));
    if (some.rms_mm > 2.0 * kRigidWithin * noise_mm_) return some;
  }
  return FitMotion(after_, before_, weight);
}

double NeighbourMotion::LeaveOut() const {
  const int step = std::max<int>(1, static_cast<int>(before_.size()) / kLeftOut);
  double squares = 0.0;
  int count = 0;
  for (int i = 0; i < static_cast<int>(before_.size()); i += step, ++count) {
    const auto u = static_cast<std::size_t>(i);
    squares += (after_[u] - MoveLocally(before_[u], i)).squaredNorm() / 3.0;
  }
  return squares / count;
}

NeighbourMotion::Place NeighbourMotion::Move(const Eigen::Vector3d& before_mm) const {
  if (!rigid_) {
    if (variance_ < 0) {  // many are asked for rigid motion only
      index_ = PointIndex(before_);
      variance_ = LeaveOut();
    }
    return {MoveLocally(before_mm, -1), variance_};
  }
  // Variance of a translation and of a turn about the points' mean.
  const double off2 = (before_mm - mean_).squaredNorm();
  const double n = static_cast<double>(before_.size());
  return {motion_ * before_mm, variance_ * (1.0 / n + off2 / std::max(spread2_, 1e-12))};
}

Eigen::Vector3d NeighbourMotion::MoveLocally(const Eigen::Vector3d& before_mm, int left_out) const {
  std::vector<PointIndex::Neighbour> found;
  index_.Nearest(before_mm, kReach * neighbours_ + 1, std::numeric_limits<double>::infinity(),
                 &found);
  std::erase_if(found, [&](const auto& f) { return f.index == left_out; });
  const std::size_t count =
      std::min<std::size_t>(found.size(), static_cast<std::size_t>(neighbours_));
  const double reach2 = std::max(found[count - 1].distance2, 1e-12);
  std::vector<Eigen::Vector3d> after, before;
  std::vector<double> weight;
  for (const auto& f : found) {
    // All keep some weight: the nearest may stand in one line and then leave the turn about it
    // open.
    const double w = 1.0 / (1.0 + f.distance2 / reach2);
    weight.push_back(w * w);
    before.push_back(before_[static_cast<std::size_t>(f.index)]);
    after.push_back(after_[static_cast<std::size_t>(f.index)]);
  }
  return FitMotion(after, before, weight).motion * before_mm;
}

}  // namespace videogrammetry
