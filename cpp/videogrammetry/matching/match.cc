#include "videogrammetry/matching/match.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>

#include "videogrammetry/matching/assignment.h"
#include "videogrammetry/matching/candidates.h"
#include "videogrammetry/matching/surface.h"

namespace videogrammetry {
namespace {

constexpr int kSurfaceRounds = 3;

void CheckArguments(const Rig& rig, std::span<const CameraTargets> cameras,
                    const MatchingOptions& options) {
  if (cameras.size() != rig.size()) {
    throw std::invalid_argument("cameras: expected " + std::to_string(rig.size()) +
                                " (the rig's number), got " + std::to_string(cameras.size()));
  }
  for (const CameraTargets& c : cameras) {
    if (c.cov_px2.size() != c.size() || c.id.size() != c.size() ||
        c.semi_major_px.size() != c.size()) {
      throw std::invalid_argument("targets: xy_px, cov_px2, id and semi_major_px differ in length");
    }
  }
  if (!(options.critical_value > 0 && options.critical_value <= 20)) {
    throw std::invalid_argument("critical_value: expected (0, 20], got " +
                                std::to_string(options.critical_value));
  }
  if (options.max_size_ratio != 0 && !(options.max_size_ratio > 1)) {
    throw std::invalid_argument("max_size_ratio: expected > 1 or 0 (off), got " +
                                std::to_string(options.max_size_ratio));
  }
  if (!(options.min_log_odds >= 0) || options.neighbours < 0) {
    throw std::invalid_argument("min_log_odds and neighbours must be >= 0");
  }
}

class StageMatcher {
 public:
  StageMatcher(const Rig& rig, std::span<const CameraTargets> cameras,
               const MatchingOptions& options)
      : rig_(rig), cameras_(cameras), options_(options) {
    for (const CameraTargets& c : cameras) {
      free_.emplace_back(c.size(), 1);
      result_.status.emplace_back(c.size(), TargetMatch::kNoPartner);
      num_targets_.push_back(c.size());
    }
  }

  MatchResult Run() {
    MatchCoded();
    std::vector<Candidate> candidates = FindCandidates(rig_, cameras_, free_, options_);
    std::vector<Choice> choices = ChooseCompatible(candidates, num_targets_);
    for (int round = 0; options_.neighbours > 0 && round < kSurfaceRounds; ++round) {
      AddSurfaceEvidence(rig_, cameras_, Reliable(candidates, choices), options_.neighbours,
                         &candidates);
      choices = ChooseCompatible(candidates, num_targets_);
    }
    Accept(candidates, choices);
    return std::move(result_);
  }

 private:
  // Coded targets by ID; one that disagrees with the others is left out and named.
  void MatchCoded() {
    std::map<int, std::vector<std::vector<int>>> places;  // id -> camera -> targets
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
      for (std::size_t t = 0; t < cameras_[c].size(); ++t) {
        const int id = cameras_[c].id[t];
        if (id < 0) continue;
        auto& lists = places.try_emplace(id, cameras_.size()).first->second;
        lists[c].push_back(static_cast<int>(t));
      }
    }
    for (const auto& [id, lists] : places) MatchOneId(lists);
  }

  void MatchOneId(const std::vector<std::vector<int>>& lists) {
    std::vector<int> target(cameras_.size(), -1);
    int seen = 0;
    for (std::size_t c = 0; c < lists.size(); ++c) {
      if (lists[c].size() != 1) continue;  // an ID twice in one picture decides nothing
      target[c] = lists[c][0];
      ++seen;
    }
    if (seen < 2) return;
    Candidate candidate;
    if (MakeCandidate(rig_, cameras_, target, options_, &candidate)) {
      Keep(candidate, candidate.score);
      return;
    }
    // Which camera's exclusion makes the others agree?
    Candidate best;
    for (std::size_t c = 0; seen > 2 && c < target.size(); ++c) {
      if (target[c] < 0) continue;
      std::vector<int> without = target;
      without[c] = -1;
      Candidate reduced;
      if (MakeCandidate(rig_, cameras_, without, options_, &reduced) &&
          (best.num_cameras == 0 || reduced.score > best.score)) {
        best = reduced;
      }
    }
    if (best.num_cameras > 0) Keep(best, best.score);
    for (std::size_t c = 0; c < target.size(); ++c) {
      if (target[c] < 0 || (best.num_cameras > 0 && best.target[c] >= 0)) continue;
      free_[c][static_cast<std::size_t>(target[c])] = 0;
      result_.status[c][static_cast<std::size_t>(target[c])] = TargetMatch::kInconsistentId;
    }
  }

  void Keep(const Candidate& candidate, double log_odds) {
    Match match;
    match.target = candidate.target;
    match.id = candidate.id;
    match.position_mm = candidate.point.position_mm;
    match.chi2 = candidate.point.chi2;
    match.log_odds = log_odds;
    result_.matches.push_back(std::move(match));
    kept_.push_back({candidate.target, candidate.point.position_mm, candidate.point.cov_mm2});
    for (std::size_t c = 0; c < candidate.target.size(); ++c) {
      if (candidate.target[c] < 0) continue;
      const auto t = static_cast<std::size_t>(candidate.target[c]);
      free_[c][t] = 0;
      result_.status[c][t] = TargetMatch::kMatched;
    }
  }

  std::vector<ReliablePoint> Reliable(const std::vector<Candidate>& candidates,
                                      const std::vector<Choice>& choices) const {
    std::vector<ReliablePoint> reliable = kept_;
    for (const Choice& choice : choices) {
      if (choice.margin < options_.min_log_odds) continue;
      const Candidate& c = candidates[choice.candidate];
      reliable.push_back({c.target, c.point.position_mm, c.point.cov_mm2});
    }
    return reliable;
  }

  void Accept(const std::vector<Candidate>& candidates, const std::vector<Choice>& choices) {
    for (const Candidate& candidate : candidates) {
      Mark(candidate, TargetMatch::kOutvoted);
    }
    for (const Choice& choice : choices) {
      if (choice.margin < options_.min_log_odds) {
        Mark(candidates[choice.candidate], TargetMatch::kAmbiguous);
      }
    }
    for (const Choice& choice : choices) {
      if (choice.margin >= options_.min_log_odds) {
        Keep(candidates[choice.candidate], choice.margin);
      }
    }
  }

  void Mark(const Candidate& candidate, TargetMatch status) {
    for (std::size_t c = 0; c < candidate.target.size(); ++c) {
      if (candidate.target[c] < 0) continue;
      TargetMatch& own = result_.status[c][static_cast<std::size_t>(candidate.target[c])];
      if (own != TargetMatch::kMatched) own = status;
    }
  }

  const Rig& rig_;
  std::span<const CameraTargets> cameras_;
  const MatchingOptions& options_;
  std::vector<std::vector<char>> free_;
  std::vector<std::size_t> num_targets_;
  std::vector<ReliablePoint> kept_;
  MatchResult result_;
};

}  // namespace

MatchResult MatchStage(const Rig& rig, std::span<const CameraTargets> cameras,
                       const MatchingOptions& options) {
  CheckArguments(rig, cameras, options);
  return StageMatcher(rig, cameras, options).Run();
}

}  // namespace videogrammetry
