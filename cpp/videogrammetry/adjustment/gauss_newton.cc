#include "videogrammetry/adjustment/gauss_newton.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "videogrammetry/adjustment/datum.h"
#include "videogrammetry/adjustment/normal_equations.h"

namespace videogrammetry {
namespace {

// A start that needs more is for a solver with more patience.
constexpr int kMaxFailures = 12;
constexpr double kFarDamping = 1e-4, kFirstDamping = 1e-6, kLeastDamping = 1e-9;

bool IsPossible(const Network& network) {
  return std::all_of(network.cameras.begin(), network.cameras.end(), [](const NetworkCamera& c) {
    return c.camera.interior.allFinite() && c.camera.f_px() > 0 && c.aspect > -1;
  });
}

/// A network's values on their way, with the normal equations there.
class Descent {
 public:
  Descent(const Network& network, const BundleOptions& options)
      : network_(network),
        options_(options),
        index_(network),
        elimination_(network, index_),
        damping_(options.near_solution ? 0.0 : kFarDamping),
        normal_(Normal(network_)) {}

  bool usable() const { return normal_ != nullptr && normal_->num_invalid == 0; }
  double cost() const { return normal_->cost; }
  Network& network() { return network_; }

  /// One step; true if it was the last one. A step that fails raises the damping.
  bool Step() {
    const auto step = normal_ == nullptr
                          ? std::nullopt
                          : normal_->Solve(DatumNullSpace(network_, index_), options_.num_threads);
    if (!step || !step->allFinite()) return Fail();
    Network trial = network_;
    MoveUnknowns(index_, *step, &trial);
    if (!IsPossible(trial)) return Fail();
    const double promised = normal_->gradient.dot(*step);
    if (promised <= options_.function_tolerance * cost() || promised <= options_.least_decrease) {
      network_ = std::move(trial);
      return true;
    }
    const double raised = damping_;
    // (far off, the damping also holds what nothing determines)
    damping_ = damping_ / 5 < kLeastDamping ? least_damping() : damping_ / 5;
    std::unique_ptr<NormalEquations> next = Normal(trial);
    if (next == nullptr || next->num_invalid > 0 || !(next->cost < cost())) {
      damping_ = raised;
      return Fail();
    }
    const double gained = cost() - next->cost;
    network_ = std::move(trial);
    normal_ = std::move(next);
    return gained <= options_.function_tolerance * cost();
  }

  int failures() const { return failures_; }
  double least_damping() const { return options_.near_solution ? 0.0 : kLeastDamping; }

 private:
  std::unique_ptr<NormalEquations> Normal(const Network& network) const {
    try {
      return std::make_unique<NormalEquations>(network, index_, elimination_,
                                               NormalOptions{options_.cauchy_scale, damping_});
    } catch (const AdjustmentError&) {
      return nullptr;
    }
  }

  bool Fail() {
    ++failures_;
    damping_ = damping_ > 0 ? 10 * damping_ : kFirstDamping;
    normal_ = Normal(network_);
    return false;
  }

  Network network_;
  BundleOptions options_;
  UnknownIndex index_;
  Elimination elimination_;
  double damping_;
  std::unique_ptr<NormalEquations> normal_;
  int failures_ = 0;
};

}  // namespace

std::optional<BundleSummary> SolveNormalEquations(Network* network, const BundleOptions& options) {
  Descent descent(*network, options);
  if (!descent.usable()) return std::nullopt;
  BundleSummary summary;
  summary.initial_cost = 0.5 * descent.cost();
  while (!summary.converged && summary.iterations++ < options.max_iterations) {
    summary.converged = descent.Step();
    if (descent.failures() > kMaxFailures || !descent.usable()) return std::nullopt;
  }
  summary.final_cost = 0.5 * descent.cost();
  summary.message = summary.converged ? "v'Pv settles" : "v'Pv still falls after all iterations";
  *network = std::move(descent.network());
  for (NetworkPose& pose : network->poses) {  // rounding of many small turns
    if (pose.free) pose.transform.rotation = NearestRotation(pose.transform.rotation);
  }
  FitToDatum(network);
  return summary;
}

}  // namespace videogrammetry
