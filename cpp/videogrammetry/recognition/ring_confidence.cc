#include "videogrammetry/recognition/ring_confidence.h"

#include <algorithm>
#include <cmath>

namespace videogrammetry {
namespace {

constexpr double kForeignPrior = 0.01, kCoveredPrior = 0.0015;
constexpr double kSqrt2Pi = 2.5066282746310002;
constexpr int kFewestBits = 4;
constexpr double kSameBorders = 0.01;

/// Weighted sum of squares of the changes' distances from the borders of m equal sectors.
double GridChi2(const float* place, const float* weight, int count, float sectors) {
  // Distances from the first change's border, then from their mean: exact where
  // the grid fits, too large where it does not fit anyway.
  float sum_w = 0, sum_d = 0, sum_dd = 0;
  for (int i = 0; i < count; ++i) {
    constexpr float kRound = 12582912.0f;  // 1.5 * 2^23: adding rounds to whole numbers
    const float p = place[i] * sectors;
    const float d = p - ((p + kRound) - kRound);
    sum_w += weight[i];
    sum_d += weight[i] * d;
    sum_dd += weight[i] * d * d;
  }
  const float per = 1.0f / (sectors * sectors);
  return static_cast<double>((sum_dd - sum_d * sum_d / sum_w) * per);
}

double OtherGrids(const RingChanges& c, double chi2, int num_bits) {
  std::array<float, kMaxCodeBits> place = {}, weight = {};
  const auto n = static_cast<float>(num_bits);
  const float first = (static_cast<float>(c.border[0]) + c.shift[0]) / n;
  for (int i = 0; i < c.count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    place[at] = (static_cast<float>(c.border[at]) + c.shift[at]) / n - first;
    const float s = c.sigma[at] / n;
    weight[at] = 1.0f / (s * s);
  }
  double odds = 0;
  for (int m = kFewestBits; m <= kMaxCodeBits; ++m) {
    if (m % num_bits == 0 || num_bits % m == 0) continue;
    const double gain =
        0.5 * (chi2 - GridChi2(place.data(), weight.data(), c.count, static_cast<float>(m)));
    // Changes that stand on both grids alike say nothing: the family is the user's word.
    if (gain < -12.0 || std::abs(gain) < kSameBorders) continue;
    odds += std::ldexp(std::exp(std::min(gain, 50.0)), std::min(0, num_bits - m));
  }
  return odds / (kMaxCodeBits - kFewestBits + 1);
}

}  // namespace

double RemovePhase(RingChanges* changes) {
  double sum = 0, weights = 0;
  for (int i = 0; i < changes->count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const double w = 1.0 / (changes->sigma[at] * changes->sigma[at]);
    sum += w * changes->shift[at];
    weights += w;
  }
  const double mean = weights > 0 ? sum / weights : 0.0;
  for (int i = 0; i < changes->count; ++i) {
    changes->shift[static_cast<std::size_t>(i)] -= static_cast<float>(mean);
  }
  return mean;
}

double ForeignProbability(const RingChanges& c, int num_bits) {
  if (c.count < 2) return 1.0;
  double chi2 = 0, log_density = 0, largest = -1e300, second = -1e300;
  for (int i = 0; i < c.count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const double z = c.shift[at] / c.sigma[at];
    chi2 += z * z;
    const double term = std::log(kSqrt2Pi * c.sigma[at]) + 0.5 * z * z;
    log_density += term;
    second = std::max(second, std::min(largest, term));
    largest = std::max(largest, term);
  }
  log_density -= log_density / c.count;
  const double odds = kForeignPrior * std::exp(std::min(log_density, 50.0)) +
                      kCoveredPrior * std::exp(std::min(largest + second, 50.0)) +
                      kForeignPrior * OtherGrids(c, chi2, num_bits);
  return odds / (1.0 + odds);
}

double WrongSectorProbability(const float* heights, const float* sigmas, int num_bits) {
  double sum = 0;
  for (int k = 0; k < num_bits; ++k) {
    const double z = std::abs(heights[k] - 0.5f) / sigmas[k];
    if (z < 6.5) sum += 0.5 * std::erfc(z * 0.70710678118654752);
  }
  return std::min(1.0, sum);
}

}  // namespace videogrammetry
