#include "videogrammetry/adjustment/variance.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "videogrammetry/core/median.h"

namespace videogrammetry {
namespace {

/// One camera's residuals: what a trial floor is judged by.
struct Sample {
  Eigen::Vector2d residual_px;
  Eigen::Matrix2d cov_px2;
};

double WeightedSquares(const std::vector<Sample>& samples, double variance) {
  double sum = 0.0;
  for (const Sample& s : samples) {
    const Eigen::Matrix2d total = s.cov_px2 + variance * Eigen::Matrix2d::Identity();
    sum += s.residual_px.dot(total.inverse() * s.residual_px);
  }
  return sum;
}

/// Solves WeightedSquares(c^2) = wanted by bisection: it falls monotonically.
double SolveVariance(const std::vector<Sample>& samples, double wanted) {
  double low = 0.0, high = 1e-6;
  while (WeightedSquares(samples, high) > wanted && high < 1e8) high *= 4;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (WeightedSquares(samples, middle) > wanted ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace

double TruncatedVariance(double k) {
  if (!(k > 0)) return 1.0;
  const double density = std::exp(-0.5 * k * k) / std::sqrt(2.0 * M_PI);
  return 1.0 - 2.0 * k * density / std::erf(k / std::sqrt(2.0));
}

std::vector<CameraVariance> CameraVariances(const Network& network,
                                            const std::vector<ObservationStatistics>& statistics) {
  std::vector<CameraVariance> all(network.cameras.size());
  std::vector<double> squares(all.size()), weighted(all.size());
  for (std::size_t i = 0; i < statistics.size(); ++i) {
    const NetworkObservation& o = network.observations[i];
    if (!o.used || !statistics[i].valid) continue;
    const int c = network.camera_of(o);
    all[c].redundancy += statistics[i].redundancy.sum();
    all[c].count += 1;
    squares[c] += statistics[i].residual_px.squaredNorm();
    weighted[c] += statistics[i].weighted_square;
  }
  for (std::size_t c = 0; c < all.size(); ++c) {
    if (all[c].redundancy > 1e-6) all[c].factor = weighted[c] / all[c].redundancy;
    if (all[c].count > 0) all[c].rms_px = std::sqrt(squares[c] / (2.0 * all[c].count));
  }
  return all;
}

std::vector<CameraNoise> EstimateNoise(const Network& network,
                                       const std::vector<ObservationStatistics>& statistics,
                                       double critical_value) {
  std::vector<std::vector<Sample>> samples(network.cameras.size());
  std::vector<double> redundancy(network.cameras.size());
  for (std::size_t i = 0; i < statistics.size(); ++i) {
    const NetworkObservation& o = network.observations[i];
    if (!o.used || !statistics[i].valid) continue;
    const int c = network.camera_of(o);
    samples[c].push_back({statistics[i].residual_px, o.cov_px2});
    redundancy[c] += statistics[i].redundancy.sum();
  }
  std::vector<CameraNoise> noise(network.cameras.size());
  const double kept = TruncatedVariance(critical_value);
  for (std::size_t c = 0; c < noise.size(); ++c) {
    const NetworkCamera& camera = network.cameras[c];
    if (redundancy[c] < 1.0) {  // nothing checks this camera
      noise[c] = {camera.floor_px, camera.cov_scale};
      continue;
    }
    const double wanted = kept * redundancy[c];
    const double ratio = WeightedSquares(samples[c], 0.0) / wanted;
    const double tolerance = 2.58 * std::sqrt(2.0 / redundancy[c]);
    if (ratio > 1.0 + tolerance) {
      noise[c].floor_px = std::sqrt(SolveVariance(samples[c], wanted));
    } else if (ratio < 1.0 - tolerance) {
      noise[c].cov_scale = std::max(ratio, 1e-6);
    }
  }
  return noise;
}

std::vector<double> RobustFloors(const Network& network,
                                 const std::vector<ObservationStatistics>& statistics) {
  std::vector<std::vector<double>> residuals(network.cameras.size()), variances(residuals.size());
  for (std::size_t i = 0; i < statistics.size(); ++i) {
    const NetworkObservation& o = network.observations[i];
    if (!o.used || !statistics[i].valid) continue;
    const int c = network.camera_of(o);
    for (int k = 0; k < 2; ++k) {
      residuals[c].push_back(std::abs(statistics[i].residual_px[k]));
      variances[c].push_back(o.cov_px2(k, k));
    }
  }
  std::vector<double> floors(network.cameras.size(), 0.0);
  for (std::size_t c = 0; c < floors.size(); ++c) {
    if (residuals[c].empty()) continue;
    const double sigma = 1.4826 * Median(residuals[c]);
    floors[c] = std::sqrt(std::max(0.0, sigma * sigma - Median(variances[c])));
  }
  return floors;
}

}  // namespace videogrammetry
