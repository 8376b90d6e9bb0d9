#include "videogrammetry/matching/match.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <stdexcept>
#include <string>

#include "videogrammetry/matching/marginals.h"
#include "videogrammetry/matching/search.h"
#include "videogrammetry/matching/stage_matcher.h"
#include "videogrammetry/matching/statistics.h"

namespace videogrammetry {
namespace {

constexpr std::size_t kMaxCameras = 64;
constexpr int kStatisticsRounds = 8;
// A change of the log odds that is none.
constexpr double kSettled = 0.1;
constexpr int kSurfaceRounds = 3;
// Enough for the statistics.
constexpr int kRoughIterations = 6;
// A target with this probability of being in some match is ambiguous, not outvoted.
constexpr double kAmbiguous = 0.1;
// What the user has said.
constexpr double kCertainLogOdds = 100.0;

void CheckOptions(const Rig& rig, const MatchingOptions& options) {
  if (rig.size() > kMaxCameras) {
    throw std::invalid_argument("cameras: expected at most 64, got " + std::to_string(rig.size()));
  }
  if (!(options.critical_value > 0 && options.critical_value <= 20)) {
    throw std::invalid_argument("critical_value: expected (0, 20], got " +
                                std::to_string(options.critical_value));
  }
  if (options.max_size_ratio != 0 && !(options.max_size_ratio > 1)) {
    throw std::invalid_argument("max_size_ratio: expected > 1 or 0 (off), got " +
                                std::to_string(options.max_size_ratio));
  }
  if (options.num_threads < 0 || options.num_threads > 1024) {
    throw std::invalid_argument("num_threads: expected 0 (one a core) to 1024, got " +
                                std::to_string(options.num_threads));
  }
  if (!(options.min_log_odds >= 0) || options.neighbours < 0) {
    throw std::invalid_argument("min_log_odds and neighbours must be >= 0");
  }
}

void CheckTargets(std::size_t rig_size, std::span<const CameraTargets> cameras) {
  if (cameras.size() != rig_size) {
    throw std::invalid_argument("cameras: expected " + std::to_string(rig_size) +
                                " (the rig's number), got " + std::to_string(cameras.size()));
  }
  for (const CameraTargets& c : cameras) {
    if (c.cov_px2.size() != c.size() || c.id.size() != c.size() ||
        c.semi_major_px.size() != c.size()) {
      throw std::invalid_argument("targets: xy_px, cov_px2, id and semi_major_px differ in length");
    }
  }
}

void CheckEdits(const MatchEdits& edits, const std::vector<std::size_t>& num_targets) {
  const auto check = [&](const ViewTarget& s, const std::string& where) {
    const bool camera = s.camera >= 0 && static_cast<std::size_t>(s.camera) < num_targets.size();
    if (!camera || s.target < 0 ||
        static_cast<std::size_t>(s.target) >= num_targets[static_cast<std::size_t>(s.camera)]) {
      throw std::invalid_argument("edits: " + where + " names target " + std::to_string(s.target) +
                                  " of camera " + std::to_string(s.camera) +
                                  ", which is not there; both count from 0 within the stage");
    }
  };
  std::set<std::pair<int, int>> used;
  for (const auto& set : edits.together) {
    std::set<int> cameras;
    for (const ViewTarget& s : set) {
      check(s, "together");
      if (!cameras.insert(s.camera).second) {
        throw std::invalid_argument("edits: a set of together has two targets of camera " +
                                    std::to_string(s.camera) + "; a point has one a camera");
      }
      if (!used.insert({s.camera, s.target}).second) {
        throw std::invalid_argument("edits: target " + std::to_string(s.target) + " of camera " +
                                    std::to_string(s.camera) + " is in two sets of together");
      }
    }
    if (set.size() < 2) {
      throw std::invalid_argument("edits: a set of together needs two targets at least, got " +
                                  std::to_string(set.size()));
    }
  }
  for (const auto& [a, b] : edits.apart) {
    check(a, "apart");
    check(b, "apart");
  }
}

double LogOdds(double probability, double score) {
  // Rounding hides what is surer than 1e-15; then no alternative is left but chance.
  const double wrong = std::max(1 - probability, std::exp(-std::clamp(score, 0.0, 700.0)));
  return std::log(std::max(1 - wrong, 1e-300) / wrong);
}

}  // namespace

StageMatcher::StageMatcher(const Rig& rig, const MatchingOptions& options) : options_(options) {
  CheckOptions(rig, options);
  for (const OrientedCamera& camera : rig) views_.emplace_back(camera);
  pairs_ = CameraPairs(views_, options_);
  targets_.resize(rig.size());
}

void StageMatcher::Begin(std::span<const CameraTargets> cameras) {
  data_ = cameras;
  result_ = {};
  free_.clear();
  num_targets_.clear();
  known_.clear();
  by_user_.clear();
  candidates_.clear();
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    targets_[c].Set(views_[c], cameras[c].xy_px, cameras[c].cov_px2);
    targets_[c].MakeGrid();
    free_.emplace_back(cameras[c].size(), 1);
    result_.status.emplace_back(cameras[c].size(), TargetMatch::kNoPartner);
    num_targets_.push_back(cameras[c].size());
  }
}

MatchResult StageMatcher::Match(std::span<const CameraTargets> cameras, const MatchEdits& edits) {
  CheckTargets(views_.size(), cameras);
  Begin(cameras);
  CheckEdits(edits, num_targets_);
  const CandidateMaker maker(views_, targets_, data_, options_, edits);
  maker_ = &maker;
  const PairFinder finder(views_, targets_, data_, pairs_, options_.critical_value);
  PutTogether(edits);
  MatchCoded();
  statistics_ = StageStatistics::Start(views_, targets_, finder.Volume(free_));
  GrowKnown();
  candidates_ = FindCandidates(maker, finder, free_, statistics_, options_.num_threads);
  Weigh();
  Accept();
  maker_ = nullptr;
  return std::move(result_);
}

void StageMatcher::PutTogether(const MatchEdits& edits) {
  for (std::vector<ViewTarget> set : edits.together) {
    std::sort(set.begin(), set.end(),
              [](const ViewTarget& p, const ViewTarget& q) { return p.camera < q.camera; });
    Candidate candidate;
    if (!maker_->Make(set, &candidate, true)) {
      throw std::invalid_argument(
          "edits: the rays of target " + std::to_string(set[0].target) + " of camera " +
          std::to_string(set[0].camera) +
          " and of those put together with it are parallel or meet behind a camera: no point "
          "comes of them; take the edit back");
    }
    Known(std::move(candidate), true);
  }
}

// Coded targets by ID; one that disagrees with the others is left out and named.
void StageMatcher::MatchCoded() {
  std::map<int, std::vector<std::vector<int>>> places;  // id -> camera -> targets
  for (std::size_t c = 0; c < data_.size(); ++c) {
    for (std::size_t t = 0; t < data_[c].size(); ++t) {
      const int id = data_[c].id[t];
      if (id < 0 || !free_[c][t]) continue;
      auto& lists = places.try_emplace(id, data_.size()).first->second;
      lists[c].push_back(static_cast<int>(t));
    }
  }
  for (const auto& [id, lists] : places) MatchOneId(lists);
}

void StageMatcher::MatchOneId(const std::vector<std::vector<int>>& lists) {
  std::vector<ViewTarget> used;
  for (std::size_t c = 0; c < lists.size(); ++c) {
    if (lists[c].size() != 1) continue;  // an ID twice in one picture decides nothing
    used.push_back({static_cast<int>(c), lists[c][0]});
  }
  if (used.size() < 2) return;
  Candidate candidate;
  if (maker_->Make(used, &candidate)) {
    Known(std::move(candidate), false);
    return;
  }
  // Which camera's exclusion makes the others agree?
  Candidate best;
  for (std::size_t k = 0; used.size() > 2 && k < used.size(); ++k) {
    std::vector<ViewTarget> without = used;
    without.erase(without.begin() + static_cast<std::ptrdiff_t>(k));
    Candidate reduced;
    if (maker_->Make(without, &reduced) &&
        (best.used.empty() || reduced.point.chi2 < best.point.chi2)) {
      best = reduced;
    }
  }
  const Candidate kept = best;
  if (!best.used.empty()) Known(std::move(best), false);
  for (const ViewTarget& s : used) {
    if (std::any_of(kept.used.begin(), kept.used.end(),
                    [&](const ViewTarget& o) { return o.camera == s.camera; })) {
      continue;
    }
    const auto c = static_cast<std::size_t>(s.camera), t = static_cast<std::size_t>(s.target);
    free_[c][t] = 0;
    result_.status[c][t] = TargetMatch::kInconsistentId;
  }
}

void StageMatcher::Known(Candidate candidate, bool by_user) {
  Take(candidate);
  known_.push_back(std::move(candidate));
  by_user_.push_back(by_user ? 1 : 0);
}

// Cameras that see a known point, but did not read its ring, or that the user left out.
void StageMatcher::GrowKnown() {
  for (Candidate& candidate : known_) {
    maker_->Grow(free_, statistics_, &candidate);
    Take(candidate);
  }
}

void StageMatcher::Take(const Candidate& candidate) {
  for (const ViewTarget& s : candidate.used) {
    const auto c = static_cast<std::size_t>(s.camera), t = static_cast<std::size_t>(s.target);
    free_[c][t] = 0;
    result_.status[c][t] = TargetMatch::kMatched;
  }
}

// Probabilities and statistics in turns.
std::vector<double> StageMatcher::WeighAll() {
  for (int round = 0; round < kStatisticsRounds; ++round) {
    SetProbabilities(num_targets_, &candidates_, 0, kRoughIterations);
    const StageStatistics before = statistics_;
    statistics_ = EstimateStatistics(views_, targets_, candidates_, known_, before);
    double change = std::abs(statistics_.log_density - before.log_density);
    for (std::size_t c = 0; c < views_.size(); ++c) {
      change = std::max(change, std::abs(statistics_.log_lone[c] - before.log_lone[c]));
    }
    for (Candidate& candidate : candidates_) candidate.score = statistics_.Score(candidate);
    if (change < kSettled) break;
  }
  SetProbabilities(num_targets_, &candidates_);
  return ProbabilitiesOfOnePoint(num_targets_, candidates_);
}

void StageMatcher::Weigh() {
  std::vector<double> probability = WeighAll();
  for (int round = 0; options_.neighbours > 0 && round < kSurfaceRounds; ++round) {
    if (!SetSurfaceScores(views_, data_, statistics_, Reliable(probability), options_.neighbours,
                          &candidates_)) {
      break;
    }
    probability = WeighAll();
  }
}

std::vector<ReliablePoint> StageMatcher::Reliable(const std::vector<double>& probability) const {
  std::vector<ReliablePoint> reliable;
  const auto add = [&](const Candidate& candidate) {
    ReliablePoint point{std::vector<int>(views_.size(), -1), candidate.point.position_mm,
                        candidate.point.cov_mm2()};
    for (const ViewTarget& s : candidate.used) {
      point.target[static_cast<std::size_t>(s.camera)] = s.target;
    }
    reliable.push_back(std::move(point));
  };
  for (const Candidate& candidate : known_) add(candidate);
  const double least = 1 / (1 + std::exp(-options_.min_log_odds));
  for (std::size_t k = 0; k < candidates_.size(); ++k) {
    // The candidate itself, not a part of a larger one.
    if (probability[k] >= least && candidates_[k].probability > 0.5) add(candidates_[k]);
  }
  return reliable;
}

void StageMatcher::Accept() {
  const std::vector<double> probability = ProbabilitiesOfOnePoint(num_targets_, candidates_);
  for (std::size_t k = 0; k < known_.size(); ++k) {
    Report(known_[k],
           by_user_[k] ? kCertainLogOdds : std::clamp(statistics_.Score(known_[k]), 0.0, 700.0));
    if (by_user_[k]) result_.matches.back().false_probability = 0;
  }
  std::vector<std::size_t> order;
  std::vector<std::vector<double>> claimed;
  for (const std::size_t n : num_targets_) claimed.emplace_back(n, -1.0);
  for (std::size_t k = 0; k < candidates_.size(); ++k) {
    for (const ViewTarget& s : candidates_[k].used) {
      double& own = claimed[static_cast<std::size_t>(s.camera)][static_cast<std::size_t>(s.target)];
      own = std::max(own, 0.0) + candidates_[k].probability;
    }
    if (LogOdds(probability[k], candidates_[k].score) >= options_.min_log_odds &&
        probability[k] >= 0.5) {
      order.push_back(k);
    }
  }
  // Of sets that contain one another the largest that is sure enough.
  std::sort(order.begin(), order.end(), [&](std::size_t p, std::size_t q) {
    const Candidate &a = candidates_[p], &b = candidates_[q];
    return a.size() != b.size() ? a.size() > b.size() : probability[p] > probability[q];
  });
  for (const std::size_t k : order) {
    const Candidate& candidate = candidates_[k];
    const bool all_free =
        std::all_of(candidate.used.begin(), candidate.used.end(), [&](const ViewTarget& s) {
          return free_[static_cast<std::size_t>(s.camera)][static_cast<std::size_t>(s.target)];
        });
    if (!all_free) continue;
    Take(candidate);
    Report(candidate, LogOdds(probability[k], candidate.score));
  }
  for (std::size_t c = 0; c < claimed.size(); ++c) {
    for (std::size_t t = 0; t < claimed[c].size(); ++t) {
      if (!free_[c][t] || claimed[c][t] < 0) continue;
      result_.status[c][t] =
          claimed[c][t] > kAmbiguous ? TargetMatch::kAmbiguous : TargetMatch::kOutvoted;
    }
  }
}

void StageMatcher::Report(const Candidate& candidate, double log_odds) {
  ::videogrammetry::Match match;
  match.target.assign(views_.size(), -1);
  for (const ViewTarget& s : candidate.used) {
    match.target[static_cast<std::size_t>(s.camera)] = s.target;
  }
  match.id = candidate.id;
  match.position_mm = candidate.point.position_mm;
  match.chi2 = candidate.point.chi2;
  match.log_odds = log_odds;
  match.false_probability = 1 / (1 + std::exp(log_odds));
  result_.matches.push_back(std::move(match));
}

MatchResult MatchStage(const Rig& rig, std::span<const CameraTargets> cameras,
                       const MatchingOptions& options, const MatchEdits& edits) {
  return StageMatcher(rig, options).Match(cameras, edits);
}

}  // namespace videogrammetry
