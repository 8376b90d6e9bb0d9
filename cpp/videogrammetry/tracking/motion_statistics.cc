#include "videogrammetry/tracking/motion_statistics.h"

#include <algorithm>
#include <cmath>

namespace videogrammetry {
namespace {

constexpr double kPrior = 3.0;          // samples that the first guess counts for
constexpr double kMemoryStages = 20.0;  // over which samples are forgotten
constexpr double kLeastMemory = 60.0;   // samples, where points are few
constexpr double kClip = 25.0;
constexpr double kMaxCorrelation = 0.998;

}  // namespace

MotionStatistics::MotionStatistics(double prior_acceleration_mm)
    : prepared_(prior_acceleration_mm > 0) {
  const double variance = prior_acceleration_mm * prior_acceleration_mm;
  // rho = 0: V2 = V3 = s^2 / 2.
  for (Moment* moment : {&second_, &third_}) {
    moment->total = moment->signal = 0.5 * variance;
    moment->count = kPrior;
  }
  Refresh();
}

void MotionStatistics::Moment::Take(double squared, double noise_var) {
  const double limit = kClip * std::max(total, noise_var);
  sum += std::min(squared / 3.0, limit);  // three coordinates
  noise_sum += noise_var;
  ++added;
}

void MotionStatistics::Moment::Commit(double memory) {
  if (added == 0) return;
  const double kept = std::min(count, std::max(memory, kLeastMemory));
  total = (kept * total + sum) / (kept + added);
  noise = (kept * noise + noise_sum) / (kept + added);
  count = kept + added;
  sum = noise_sum = 0.0;
  added = 0;
  // A mean square of 3n numbers is known to sqrt(2 / (3 n)) of itself.
  const double floor = noise * std::sqrt(2.0 / (3.0 * count));
  signal = std::max(total - noise, std::max(floor, 1e-12 * total));
}

void MotionStatistics::Add(const std::array<Eigen::Vector3d, 4>& x, const std::array<double, 4>& s2,
                           bool has_fourth) {
  const Eigen::Vector3d second = x[0] - 2.0 * x[1] + x[2];
  second_.Take(second.squaredNorm(), s2[0] + 4.0 * s2[1] + s2[2]);
  if (!has_fourth) return;
  const Eigen::Vector3d third = x[0] - 3.0 * x[1] + 3.0 * x[2] - x[3];
  third_.Take(third.squaredNorm(), s2[0] + 9.0 * (s2[1] + s2[2]) + s2[3]);
}

void MotionStatistics::Commit() {
  const double added = second_.added;
  if (added == 0) return;
  second_.Commit(kMemoryStages * added);
  third_.Commit(kMemoryStages * std::max(third_.added, 1));
  Refresh();
}

void MotionStatistics::Refresh() {
  const double ratio = second_.signal > 0 ? third_.signal / second_.signal : 1.0;
  model_.correlation = std::clamp(1.0 - ratio, 0.0, kMaxCorrelation);
  model_.acceleration_var = std::max(2.0 * second_.signal / (1.0 + model_.correlation), 1e-18);
}

}  // namespace videogrammetry
