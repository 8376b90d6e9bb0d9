#include "videogrammetry/adjustment/adjust.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "videogrammetry/adjustment/bundle.h"
#include "videogrammetry/adjustment/robust_start.h"
#include "videogrammetry/adjustment/snooping.h"
#include "videogrammetry/adjustment/starved.h"
#include "videogrammetry/adjustment/test_distributions.h"
#include "videogrammetry/core/errors.h"

namespace videogrammetry {
namespace {

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

double SigmaZero(const Dispersion& dispersion) {
  return std::sqrt(dispersion.weighted_squares() / std::max(1, dispersion.redundancy()));
}

/// How often each observation has been rejected.
struct RoundsOut {
  std::vector<int> observation, bar, point;
  explicit RoundsOut(const Network& network) {
    for (const NetworkObservation& o : network.observations) observation.push_back(o.used ? 0 : 1);
    for (const NetworkScaleBar& b : network.scale_bars) bar.push_back(b.used ? 0 : 1);
    for (const NetworkPoint& p : network.points) point.push_back(p.prior_used ? 0 : 1);
  }
};

/// One round of the test of single observations. With sigma0 from the network
/// itself the w become Pope's tau, the points' joint test alike.
bool Snoop(Network* network, const Dispersion& dispersion, const AdjustOptions& options,
           const std::vector<ObservationStatistics>& stated, RoundsOut* rounds_out) {
  std::vector<ObservationStatistics> statistics = stated;
  std::vector<BarStatistics> bars = dispersion.StatisticsOfBars();
  std::vector<PointStatistics> points = dispersion.StatisticsOfPoints();
  double critical_value = options.critical_value;
  if (!options.baarda) {
    critical_value = PopeTau(options.critical_value, dispersion.redundancy());
    const double sigma0 = std::max(SigmaZero(dispersion), 1e-12);
    for (ObservationStatistics& s : statistics) s.normalised /= sigma0;
    for (BarStatistics& s : bars) s.normalised /= sigma0;
    for (PointStatistics& s : points) s.test /= sigma0;
  }
  SnoopingChange change = SnoopPriorsOnce(network, statistics, bars, points, critical_value,
                                          &rounds_out->bar, &rounds_out->point);
  if (change.rejected == 0) {
    const SnoopingChange of_image_points =
        SnoopOnce(network, statistics, critical_value, &rounds_out->observation);
    change.rejected += of_image_points.rejected;
    change.readmitted += of_image_points.readmitted;
  }
  return change.rejected + change.readmitted > 0;
}

/// One look at the present solution: observations, then weights, that must
/// change. True if something did. Floors wait until no outlier is left that
/// would raise them; until then those of the robust start hold.
bool Revise(Network* network, const Dispersion& dispersion, const AdjustOptions& options,
            RoundsOut* rounds_out, AdjustResult* result) {
  result->statistics = dispersion.Statistics();
  if (options.critical_value > 0 &&
      Snoop(network, dispersion, options, result->statistics, rounds_out)) {
    return true;
  }
  if (!options.estimate_floor) return false;
  return UpdateNoise(network, EstimateNoise(*network, result->statistics, options.critical_value));
}

void CheckRedundancy(const Network& network, const Dispersion& dispersion) {
  if (dispersion.redundancy() > 0) return;
  throw AdjustmentError("too few observations: " + std::to_string(dispersion.num_observations()) +
                        " image coordinates in " + std::to_string(network.images.size()) +
                        " pictures for " + std::to_string(dispersion.index().num_unknowns) +
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
    CameraVector loose = 0.1 * CameraScale(camera.camera);
    loose[kF] = 0.5 * camera.camera.f_px();
    loose[kX0] = loose[kY0] = 0.1 * side;
    loose[kE1] = loose[kE2] = loose[kAspect] = 0.05;
    loose[kTimeOffset] = 1.0;
    for (int k = 0; k < kNumCameraUnknowns; ++k) {
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

/// The dispersion at the present values; parameters that leave it singular are
/// held, points that their pictures do not determine are set aside.
Dispersion RegularDispersion(Network* network, const BundleOptions& bundle, RoundsOut* rounds_out,
                             BundleSummary* summary, AdjustResult* result) {
  while (true) {
    try {
      return Dispersion(*network, Elimination::What::kSmallest, bundle.num_threads);
    } catch (const UndeterminedPointError& error) {
      HoldPoint(network, error.point(), &rounds_out->observation, &rounds_out->bar);
      while (HoldStarved(network, &rounds_out->observation, &rounds_out->bar)) {
      }
    } catch (const AdjustmentError&) {
      if (!HoldSingular(network, result)) throw;
    }
    *summary = SolveBundle(network, bundle);
  }
}

/// Variance factors of the a-priori positions and of the scale bars.
void SummarisePriors(const Network& network, const Dispersion& dispersion, AdjustResult* result) {
  result->points = dispersion.StatisticsOfPoints();
  result->bars = dispersion.StatisticsOfBars();
  for (std::size_t p = 0; p < result->points.size(); ++p) {
    if (network.points[p].is_observed()) result->point_redundancy += result->points[p].redundancy;
  }
  for (std::size_t b = 0; b < result->bars.size(); ++b) {
    if (network.scale_bars[b].used) result->bar_redundancy += result->bars[b].redundancy;
  }
  // Less than that is rounding: nothing checks them.
  if (result->point_redundancy > 1e-3) {
    result->point_factor = dispersion.point_squares() / result->point_redundancy;
  }
  if (result->bar_redundancy > 1e-3) {
    result->bar_factor = dispersion.bar_squares() / result->bar_redundancy;
  }
}

}  // namespace

AdjustResult Adjust(Network* network, const AdjustOptions& options) {
  AdjustResult result;
  bool loose = options.significance > 0 && !options.offered.empty();
  std::vector<CameraVector> priors;
  for (const NetworkCamera& c : network->cameras) priors.push_back(c.prior_sigma);
  if (loose) AddLoosePriors(network, options);
  if (options.robust_start) {
    network->Check();
    RobustStart(network, options);
    if (options.critical_value > 0)
      SetOutliersAside(network, 2.0 * options.critical_value, options.baarda);
  }
  BundleOptions bundle;
  bundle.num_threads = options.num_threads;
  RoundsOut rounds_out(*network);
  for (int round = 1;; ++round) {
    while (HoldStarved(network, &rounds_out.observation, &rounds_out.bar)) {
    }
    BundleSummary summary = SolveBundle(network, bundle);
    const Dispersion dispersion =
        RegularDispersion(network, bundle, &rounds_out, &summary, &result);
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
    if (last) result.statistics = dispersion.Statistics();  // (else of Revise)
    result.cameras = CameraVariances(*network, result.statistics);
    result.sigma0 = SigmaZero(dispersion);
    result.num_observations = dispersion.num_observations();
    result.num_prior = dispersion.num_prior();
    result.num_unknowns = dispersion.index().num_unknowns;
    result.redundancy = dispersion.redundancy();
    SummarisePriors(*network, dispersion, &result);
    return result;
  }
}

}  // namespace videogrammetry
