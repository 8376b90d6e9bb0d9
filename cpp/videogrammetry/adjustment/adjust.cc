#include "videogrammetry/adjustment/adjust.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "videogrammetry/adjustment/bundle.h"
#include "videogrammetry/adjustment/snooping.h"
#include "videogrammetry/core/errors.h"

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
    const NetworkImage& image = network.images[o.image];
    const auto pixel = Project(network.cameras[image.camera].camera,
                               network.CamFromObject(image) * network.points[o.point].position_mm);
    if (!pixel) continue;
    all[i].valid = true;
    all[i].residual_px = o.xy_px - *pixel;
  }
  return all;
}

/// Cauchy's loss, first with a wide floor and only f and A1, then with all that is free.
BundleSummary RobustStart(Network* network, const AdjustOptions& options) {
  BundleOptions bundle;
  bundle.near_solution = false;
  bundle.cauchy_scale = 3.0;
  bundle.num_threads = options.num_threads;
  std::vector<double> floors(network->cameras.size(), kStartFloorPx);
  for (const NetworkCamera& c : network->cameras) {
    floors[&c - network->cameras.data()] = std::max(kStartFloorPx, c.floor_px);
  }
  SetFloors(network, floors);
  std::vector<std::array<bool, kNumInterior>> wanted;
  for (NetworkCamera& c : network->cameras) {
    wanted.push_back(c.free);
    for (int k = 0; k < kNumInterior; ++k) c.free[k] = c.free[k] && (k == kF || k == kA1);
  }
  SolveBundle(network, bundle);
  for (std::size_t c = 0; c < wanted.size(); ++c) network->cameras[c].free = wanted[c];
  BundleSummary summary = SolveBundle(network, bundle);
  SetFloors(network, RobustFloors(*network, PlainResiduals(*network)));
  bundle.near_solution = true;
  summary = SolveBundle(network, bundle);
  if (options.estimate_floor) {
    SetFloors(network, RobustFloors(*network, PlainResiduals(*network)));
  } else {
    SetFloors(network, std::vector<double>(floors.size(), 0.0));
  }
  return summary;
}

/// Takes the new noise over if it differs by half a per cent somewhere.
bool UpdateNoise(Network* network, const std::vector<CameraNoise>& noise) {
  auto differs = [](double a, double b) { return std::abs(a - b) > 0.005 * std::max(a, b); };
  bool moved = false;
  for (std::size_t c = 0; c < noise.size(); ++c) {
    const NetworkCamera& camera = network->cameras[c];
    moved |= differs(noise[c].floor_px, camera.floor_px) ||
             differs(noise[c].cov_scale, camera.cov_scale);
  }
  for (std::size_t c = 0; moved && c < noise.size(); ++c) {
    network->cameras[c].floor_px = noise[c].floor_px;
    network->cameras[c].cov_scale = noise[c].cov_scale;
  }
  return moved;
}

/// One look at the present solution: observations, then weights, that must
/// change. True if something did. Floors wait until no outlier is left that
/// would raise them; until then those of the robust start hold.
bool Revise(Network* network, const Dispersion& dispersion, const AdjustOptions& options,
            std::vector<int>* rounds_out, AdjustResult* result) {
  result->statistics = dispersion.Statistics();
  if (options.critical_value > 0) {
    const SnoopingChange change =
        SnoopOnce(network, result->statistics, options.critical_value, rounds_out);
    if (change.rejected + change.readmitted > 0) return true;
  }
  if (!options.estimate_floor) return false;
  return UpdateNoise(network, EstimateNoise(*network, result->statistics, options.critical_value));
}

/// Sets aside what the robust start leaves beyond `limit` standard deviations:
/// a wrong number hundreds of pixels off would bend every least-squares fit so
/// far that the w-test points at good observations. The test re-admits what fits.
void SetOutliersAside(Network* network, double limit) {
  const std::vector<ObservationStatistics> residuals = PlainResiduals(*network);
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    NetworkObservation& o = network->observations[i];
    const Eigen::Vector2d sigma = network->TotalCov(o).diagonal().cwiseSqrt();
    o.used = o.used && residuals[i].valid &&
             residuals[i].residual_px.cwiseQuotient(sigma).cwiseAbs().maxCoeff() < limit;
  }
}

/// Holds every pose that sees fewer than `kMinPoints` different points and sets
/// its observations aside for good: a stage whose pictures were all
/// rejected must not make the normal equations singular.
bool HoldStarvedPoses(Network* network, std::vector<int>* rounds_out) {
  constexpr int kMinPoints = 4;
  std::vector<int> count(network->poses.size());
  std::vector<std::vector<bool>> seen(count.size(), std::vector<bool>(network->points.size()));
  for (const NetworkObservation& o : network->observations) {
    if (!o.used) continue;
    for (const int pose : {network->images[o.image].inner, network->images[o.image].outer}) {
      if (pose < 0 || seen[pose][o.point]) continue;
      seen[pose][o.point] = true;
      ++count[pose];
    }
  }
  auto starved = [&](int pose) {
    return pose >= 0 && network->poses[pose].free && count[pose] < kMinPoints;
  };
  bool held = false;
  for (std::size_t i = 0; i < network->observations.size(); ++i) {
    NetworkObservation& o = network->observations[i];
    const NetworkImage& image = network->images[o.image];
    if (!starved(image.inner) && !starved(image.outer)) continue;
    o.used = false;
    (*rounds_out)[i] = 2;
    held = true;
  }
  for (std::size_t p = 0; p < count.size(); ++p) {
    if (starved(static_cast<int>(p))) network->poses[p].free = false;
  }
  return held;
}

double SigmaZero(const Dispersion& dispersion) {
  return std::sqrt(dispersion.weighted_squares() / std::max(1, dispersion.redundancy()));
}

void CheckRedundancy(const Network& network, const Dispersion& dispersion) {
  if (dispersion.redundancy() > 0) return;
  throw AdjustmentError("too few observations: " + std::to_string(dispersion.num_observations()) +
                        " image coordinates in " + std::to_string(network.images.size()) +
                        " pictures for " + std::to_string(dispersion.index().num_unknowns()) +
                        " unknowns");
}

/// Observes the parameters of cameras under test loosely (f to half of itself,
/// the principal point to a tenth of the picture, each distortion term to a
/// tenth of the radius at r0, affinity to 5 %), until what is not needed has
/// gone: ten parameters on a few flat pictures are nearly singular, and least
/// squares would leave for f = 4 px. The loose priors never enter the result.
void AddLoosePriors(Network* network, const AdjustOptions& options) {
  for (std::size_t c = 0; c < network->cameras.size(); ++c) {
    NetworkCamera& camera = network->cameras[c];
    const auto& offered = options.offered[c];
    if (std::none_of(offered.begin(), offered.end(), [](bool is) { return is; })) continue;
    const double side = std::max(camera.camera.width_px, camera.camera.height_px);
    InteriorVector loose = 0.1 * InteriorScale(camera.camera);
    loose[kF] = 0.5 * camera.camera.f_px();
    loose[kX0] = loose[kY0] = 0.1 * side;
    loose[kE1] = loose[kE2] = 0.05;
    for (int k = 0; k < kNumInterior; ++k) {
      if (!(camera.prior_sigma[k] > 0)) camera.prior_sigma[k] = loose[k];
    }
  }
}

bool TestParameters(Network* network, const Dispersion& dispersion, const AdjustOptions& options,
                    AdjustResult* result) {
  const double sigma0 = SigmaZero(dispersion);
  std::vector<DroppedParameter> dropped;
  if (options.significance > 0 && !options.offered.empty()) {
    dropped = DropInsignificant(network, dispersion, options.offered, sigma0, options.significance);
  }
  // Only then: near the picture's centre A1, A2, A3 together look like f, so
  // that f seems undetermined until those that are not needed have gone.
  if (dropped.empty()) dropped = HoldUndetermined(network, dispersion, sigma0);
  result->dropped.insert(result->dropped.end(), dropped.begin(), dropped.end());
  return !dropped.empty();
}

/// What to do about singular normal equations: with f and the principal point
/// of every camera observed as loosely as themselves, those that stay as loose
/// are held. False if that is not what makes the system singular.
bool HoldSingular(Network* network, AdjustResult* result) {
  Network loose = *network;
  for (NetworkCamera& c : loose.cameras) {
    const double side = std::max(c.camera.width_px, c.camera.height_px);
    for (const int k : {kF, kX0, kY0}) {
      if (!(c.prior_sigma[k] > 0)) c.prior_sigma[k] = k == kF ? c.camera.f_px() : side;
    }
  }
  std::vector<DroppedParameter> held;
  try {
    held = HoldUndetermined(&loose, Dispersion(loose), 1.0);
  } catch (const AdjustmentError&) {
    return false;
  }
  for (std::size_t c = 0; c < loose.cameras.size(); ++c) {
    loose.cameras[c].prior_sigma = network->cameras[c].prior_sigma;
  }
  *network = std::move(loose);
  result->dropped.insert(result->dropped.end(), held.begin(), held.end());
  return !held.empty();
}

/// The dispersion at the present values; parameters that leave it singular are held.
Dispersion RegularDispersion(Network* network, const BundleOptions& bundle, BundleSummary* summary,
                             AdjustResult* result) {
  while (true) {
    try {
      return Dispersion(*network);
    } catch (const AdjustmentError&) {
      if (!HoldSingular(network, result)) throw;
    }
    *summary = SolveBundle(network, bundle);
  }
}

}  // namespace

AdjustResult Adjust(Network* network, const AdjustOptions& options) {
  AdjustResult result;
  bool loose = options.significance > 0 && !options.offered.empty();
  std::vector<InteriorVector> priors;
  for (const NetworkCamera& c : network->cameras) priors.push_back(c.prior_sigma);
  if (loose) AddLoosePriors(network, options);
  if (options.robust_start) {
    RobustStart(network, options);
    if (options.critical_value > 0) SetOutliersAside(network, 2.0 * options.critical_value);
  }
  BundleOptions bundle;
  bundle.num_threads = options.num_threads;
  std::vector<int> rounds_out(network->observations.size(), 0);
  for (std::size_t i = 0; i < rounds_out.size(); ++i) {
    rounds_out[i] = network->observations[i].used ? 0 : 1;
  }
  for (int round = 1;; ++round) {
    while (HoldStarvedPoses(network, &rounds_out)) {
    }
    BundleSummary summary = SolveBundle(network, bundle);
    const Dispersion dispersion = RegularDispersion(network, bundle, &summary, &result);
    CheckRedundancy(*network, dispersion);
    result.rounds = round;
    result.converged = summary.converged;
    result.message = summary.message;
    const bool last = round >= options.max_rounds;
    bool changed = !last && Revise(network, dispersion, options, &rounds_out, &result);
    if (!changed && !last) changed = TestParameters(network, dispersion, options, &result);
    if (loose && (last || !changed || !result.dropped.empty())) {
      for (std::size_t c = 0; c < priors.size(); ++c) network->cameras[c].prior_sigma = priors[c];
      loose = false;
      changed = true;
    }
    if (changed) continue;
    result.statistics = dispersion.Statistics();
    result.cameras = CameraVariances(*network, result.statistics);
    result.sigma0 = SigmaZero(dispersion);
    result.num_observations = dispersion.num_observations();
    result.num_prior = dispersion.num_prior();
    result.num_unknowns = dispersion.index().num_unknowns();
    result.redundancy = dispersion.redundancy();
    result.point_redundancy = dispersion.point_redundancy();
    if (result.point_redundancy > 1e-3) {
      result.point_factor = dispersion.point_squares() / result.point_redundancy;
    }
    return result;
  }
}

}  // namespace videogrammetry
