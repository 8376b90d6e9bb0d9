#pragma once

#include <vector>

#include "videogrammetry/matching/candidates.h"

namespace videogrammetry {

/// A chosen candidate and by how much it beats what would replace it.
struct Choice {
  std::size_t candidate = 0;
  double margin = 0.0;  // log odds; its own score where nothing conflicts
};

/// Chooses compatible candidates (no target in two of them) of the largest
/// total score: greedy start, then exchanges (a candidate against those that it
/// conflicts with, with whatever fits into the freed targets) until none gains.
/// Candidates of score <= 0 are never chosen.
///
/// @param num_targets  targets of each camera.
std::vector<Choice> ChooseCompatible(const std::vector<Candidate>& candidates,
                                     const std::vector<std::size_t>& num_targets);

}  // namespace videogrammetry
