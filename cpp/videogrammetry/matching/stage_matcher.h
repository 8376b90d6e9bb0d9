#pragma once

#include <span>
#include <vector>

#include "videogrammetry/matching/candidates.h"
#include "videogrammetry/matching/surface.h"

namespace videogrammetry {

/// Matches one stage after another of the same rig; storage is used again.
class StageMatcher {
 public:
  /// `rig` must outlive it.
  /// @throws std::invalid_argument as MatchStage, for cameras and options.
  StageMatcher(const Rig& rig, const MatchingOptions& options);

  MatchResult Match(std::span<const CameraTargets> cameras, const MatchEdits& edits);

 private:
  void Begin(std::span<const CameraTargets> cameras);
  void PutTogether(const MatchEdits& edits);
  void MatchCoded();
  void MatchOneId(const std::vector<std::vector<int>>& lists);
  void Weigh();
  void GrowKnown();
  void Accept();
  void Known(Candidate candidate, bool by_user);
  std::vector<ReliablePoint> Reliable(const std::vector<double>& probability) const;
  void Take(const Candidate& candidate);
  void Report(const Candidate& candidate, double log_odds);
  std::vector<double> WeighAll();

  const MatchingOptions options_;
  std::vector<CameraView> views_;
  std::vector<CameraPair> pairs_;
  std::vector<TargetView> targets_;
  std::span<const CameraTargets> data_;
  const CandidateMaker* maker_ = nullptr;
  StageStatistics statistics_;
  std::vector<std::vector<char>> free_;
  std::vector<std::size_t> num_targets_;
  std::vector<Candidate> known_;  // by ID or by the user
  std::vector<char> by_user_;     // one a known
  std::vector<Candidate> candidates_;
  MatchResult result_;
};

}  // namespace videogrammetry
