#include "videogrammetry/adjustment/robust_start.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "videogrammetry/adjustment/datum.h"
#include "videogrammetry/adjustment/observation_model.h"
#include "videogrammetry/core/errors.h"
#include "videogrammetry/core/median.h"

namespace videogrammetry {
namespace {

// While the values are only start values, an error of several pixels is
// normal: this floor keeps the weights finite and Cauchy's loss out of its tail.
constexpr double kStartFloorPx = 1.0;

void SetFloors(Network* network, const std::vector<double>& floors) {
  for (std::size_t c = 0; c < floors.size(); ++c) network->cameras[c].floor_px = floors[c];
}

std::vector<ObservationStatistics> PlainResiduals(const Network& network) {
  std::vector<ObservationStatistics> all(network.observations.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    const NetworkObservation& o = network.observations[i];
    const auto pixel = PredictObservation(network, o);
    if (!pixel) continue;
    all[i].valid = true;
    all[i].residual_px = o.xy_px - *pixel;
  }
  return all;
}

Network WithoutBars(const Network& network) {
  Network without = network;
  for (NetworkScaleBar& bar : without.scale_bars) bar.used = false;
  return without;
}

/// Whether the scale of a free network is that of its bars and of nothing else.
bool ScaleIsOfBars(const Network& network) {
  return FreeDatumSize(network) == 6 && FreeDatumSize(WithoutBars(network)) == 7;
}

/// Brings a free network to the median scale of its bars: with a scale far off, every bar
/// would look like an outlier to the robust loss.
void ScaleToBars(Network* network) {
  std::vector<double> ratios;
  for (const NetworkScaleBar& bar : network->scale_bars) {
    const double length_mm =
        (network->points[bar.a].position_mm - network->points[bar.b].position_mm).norm();
    if (bar.used && length_mm > 0) ratios.push_back(bar.length_mm / length_mm);
  }
  if (ratios.empty()) return;
  const double scale = Median(std::move(ratios));
  for (NetworkPoint& p : network->points) p.position_mm *= scale;
  for (NetworkPose& p : network->poses) {
    if (p.free) p.transform.translation_mm *= scale;
  }
}

/// sigma0 by the median of the image points' residuals.
double RobustSigmaZero(const Network& network,
                       const std::vector<ObservationStatistics>& residuals) {
  std::vector<double> sizes;
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    const NetworkObservation& o = network.observations[i];
    if (!o.used || !residuals[i].valid) continue;
    const Eigen::Vector2d sigma = network.TotalCov(o).diagonal().cwiseSqrt();
    for (int k = 0; k < 2; ++k) sizes.push_back(std::abs(residuals[i].residual_px[k] / sigma[k]));
  }
  if (sizes.empty()) return 1.0;
  const double n = static_cast<double>(sizes.size());
  const double redundancy = std::max(n - UnknownIndex(network).num_unknowns, 0.1 * n);
  // Not 0 of exact pictures: rounding is no noise.
  return std::max(1.4826 * Median(std::move(sizes)) * std::sqrt(n / redundancy), 1e-4);
}

/// Scale bars and a-priori positions beyond `limit` standard deviations, those of the
/// adjusted lengths and positions included; unless too few would stay.
void SetPriorsAside(Network* network, double limit) {
  const auto is_observed = [](const NetworkPoint& p) { return p.is_observed(); };
  const auto is_used = [](const NetworkScaleBar& b) { return b.used; };
  // What is within its own standard deviations is so with the adjusted ones as
  // well; the dispersion costs as much as an adjustment.
  const auto is_point_suspect = [&](const NetworkPoint& p) {
    return p.is_observed() && !((p.prior_mm - p.position_mm)
                                    .cwiseQuotient(p.prior_cov_mm2.diagonal().cwiseSqrt())
                                    .cwiseAbs()
                                    .maxCoeff() < limit);
  };
  const auto is_bar_suspect = [&](const NetworkScaleBar& b) {
    const double length_mm =
        (network->points[b.a].position_mm - network->points[b.b].position_mm).norm();
    return b.used && !(std::abs(b.length_mm - length_mm) < limit * b.sigma_mm);
  };
  if (std::none_of(network->points.begin(), network->points.end(), is_point_suspect) &&
      std::none_of(network->scale_bars.begin(), network->scale_bars.end(), is_bar_suspect)) {
    return;
  }
  Network changed = *network;
  // Where bars took no part in the start, what they are held against has no part of them.
  const bool alone = ScaleIsOfBars(*network);
  const Network held_against = alone ? WithoutBars(*network) : *network;
  try {
    const Dispersion dispersion(held_against);
    const std::vector<BarStatistics> bars = dispersion.StatisticsOfBars();
    for (std::size_t b = 0; b < bars.size(); ++b) {
      NetworkScaleBar& bar = changed.scale_bars[b];
      // Of a used one, 1 - redundancy is the adjusted length's variance over the given one's.
      const double w =
          alone ? bars[b].normalised
                : bars[b].residual_mm / (bar.sigma_mm * std::sqrt(2.0 - bars[b].redundancy));
      bar.used = bar.used && std::abs(w) < limit;
    }
    for (std::size_t p = 0; p < changed.points.size(); ++p) {
      NetworkPoint& point = changed.points[p];
      if (!point.is_observed()) continue;
      const Eigen::Vector3d v = point.prior_mm - point.position_mm;
      const Eigen::Matrix3d total = point.prior_cov_mm2 + dispersion.CovPoint(static_cast<int>(p));
      point.prior_used =
          v.cwiseQuotient(total.diagonal().cwiseSqrt()).cwiseAbs().maxCoeff() < limit;
    }
  } catch (const AdjustmentError&) {
    return;  // what makes the network singular is dealt with later
  }
  const bool bars_stay = std::any_of(changed.scale_bars.begin(), changed.scale_bars.end(), is_used);
  if (bars_stay) network->scale_bars = changed.scale_bars;
  if (std::count_if(changed.points.begin(), changed.points.end(), is_observed) >= 3) {
    network->points = changed.points;
  }
  network->prior_block.Update(network->points);
}

/// Of the cameras only f and A1, of windows nothing: what rough poses and points do not mislead.
void SolveRoughly(Network* network, const BundleOptions& bundle) {
  std::vector<CameraMask> wanted;
  for (NetworkCamera& c : network->cameras) {
    wanted.push_back(c.free);
    for (int k = 0; k < kNumCameraUnknowns; ++k) c.free[k] = c.free[k] && (k == kF || k == kA1);
  }
  std::vector<std::array<bool, kNumInterfaceUnknowns>> wanted_of_windows;
  for (NetworkInterface& i : network->interfaces) {
    wanted_of_windows.push_back(std::exchange(i.free, {}));
  }
  SolveBundle(network, bundle);
  for (std::size_t i = 0; i < wanted_of_windows.size(); ++i) {
    network->interfaces[i].free = wanted_of_windows[i];
  }
  for (std::size_t c = 0; c < wanted.size(); ++c) network->cameras[c].free = wanted[c];
}

}  // namespace

BundleSummary RobustStart(Network* network, const AdjustOptions& options) {
  const bool by_bars = ScaleIsOfBars(*network);
  const std::vector<NetworkScaleBar> bars = network->scale_bars;
  if (by_bars) {
    ScaleToBars(network);
    *network = WithoutBars(*network);
  }
  BundleOptions bundle;
  bundle.near_solution = false;
  bundle.cauchy_scale = 3.0;
  // Rough, for what follows begins anew with other weights.
  bundle.function_tolerance = 1e-3;
  // (a hundredth of the start's floor, which is far above the points' noise)
  bundle.least_decrease = 2e-4 * static_cast<double>(network->observations.size());
  bundle.num_threads = options.num_threads;
  std::vector<double> floors(network->cameras.size(), kStartFloorPx);
  for (const NetworkCamera& c : network->cameras) {
    floors[&c - network->cameras.data()] = std::max(kStartFloorPx, c.floor_px);
  }
  SetFloors(network, floors);
  // Where most points already lie within the floor, all parameters may move at once.
  const std::vector<double> scatter = RobustFloors(*network, PlainResiduals(*network));
  const bool rough = !std::all_of(scatter.begin(), scatter.end(),
                                  [](double floor_px) { return floor_px < kStartFloorPx; });
  if (rough) SolveRoughly(network, bundle);
  BundleSummary summary = SolveBundle(network, bundle);
  SetFloors(network, RobustFloors(*network, PlainResiduals(*network)));
  bundle.near_solution = true;
  bundle.function_tolerance = 1e-6;
  bundle.least_decrease = BundleOptions().least_decrease;
  summary = SolveBundle(network, bundle);
  network->scale_bars = bars;
  if (by_bars) ScaleToBars(network);
  if (options.estimate_floor) {
    SetFloors(network, RobustFloors(*network, PlainResiduals(*network)));
  } else {
    SetFloors(network, std::vector<double>(floors.size(), 0.0));
  }
  return summary;
}

void SetOutliersAside(Network* network, double limit, bool baarda) {
  const std::vector<ObservationStatistics> residuals = PlainResiduals(*network);
  if (!baarda) limit *= RobustSigmaZero(*network, residuals);
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    NetworkObservation& o = network->observations[i];
    const Eigen::Vector2d sigma = network->TotalCov(o).diagonal().cwiseSqrt();
    o.used = o.used && residuals[i].valid &&
             residuals[i].residual_px.cwiseQuotient(sigma).cwiseAbs().maxCoeff() < limit;
  }
  SetPriorsAside(network, limit);
}

}  // namespace videogrammetry
