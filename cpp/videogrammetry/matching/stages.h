#pragma once

#include <map>
#include <vector>

#include "videogrammetry/matching/match.h"

namespace videogrammetry {

/// One camera's targets over S stages, one after another; those of stage s are
/// offsets[s] ... offsets[s + 1] - 1.
struct FlatTargets {
  std::vector<std::size_t> offsets;  ///< S + 1
  CameraTargets targets;             ///< M
};

/// Matches over S stages; those of stage s are offsets[s] ... offsets[s + 1] - 1.
struct StageMatches {
  std::vector<std::size_t> offsets;  ///< S + 1
  std::vector<int> target;           ///< P x C: index within the stage's and camera's targets or -1
  std::vector<int> id;
  std::vector<double> chi2, log_odds, false_probability;
  std::vector<std::vector<TargetMatch>> status;  ///< a camera, its M targets
};

/// Matches the targets of a chunk of stages, each in the light of the others.
///
/// A stage at a time: targets by ID as MatchStage; then every point known from the
/// stages before is predicted by constant velocity (a Kalman filter of position and
/// velocity with white acceleration, whose size follows each point's own innovations)
/// and projected; the nearest targets within the gate of the prediction are its own if
/// their rays meet (chi-square of the rays alone). What is left goes through the full
/// search of MatchStage, which also takes what is merely likely.
///
/// A stage at which a point's rays, found at their predicted places, meet adds to the
/// log odds that its targets are one point's
///   sum over 2n - 3 of [log k - r^2/2 (1 - 1/k^2)],
/// k the standard deviation of a target about its predicted place over that of its
/// centre, r the rays' residuals in standard deviations: under "not one point" each
/// target is anywhere where the prediction allows it. The gain is positive in the mean
/// for one point and vanishes where the prediction says all; residuals that persist
/// take it away. A point whose log odds come below zero is dissolved.
///
/// Backwards through the chunk, points are then followed to stages before the first
/// at which the search had found them. A match is kept if its point's log odds at the
/// end are min_log_odds: what is proven later counts earlier, and what is refuted too.
///
/// One pass costs O(N) a stage while all is coded or predicted. Deterministic.
///
/// @param edits  by stage (from 0); such a stage is searched in full.
/// @throws std::invalid_argument as MatchStage, and if offsets do not rise to the
///     number of targets or differ in length between the cameras.
StageMatches MatchStages(const Rig& rig, const std::vector<FlatTargets>& cameras,
                         const MatchingOptions& options = {},
                         const std::map<std::size_t, MatchEdits>& edits = {});

}  // namespace videogrammetry
