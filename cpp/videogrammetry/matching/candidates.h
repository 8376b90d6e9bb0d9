#pragma once

#include <span>
#include <vector>

#include "videogrammetry/matching/match.h"

namespace videogrammetry {

/// A set of targets, at most one a camera, whose rays meet within the gate.
struct Candidate {
  std::vector<int> target;  // one a camera: index or -1
  int id = -1;
  int num_cameras = 0;
  Intersection point;
  double geometric_score = 0.0;  // log likelihood ratio without the surface
  double score = 0.0;            // with it
};

/// All candidates among the targets that `free` marks (a camera, a target).
std::vector<Candidate> FindCandidates(const Rig& rig, std::span<const CameraTargets> cameras,
                                      const std::vector<std::vector<char>>& free,
                                      const MatchingOptions& options);

/// Intersects a set of targets and scores it; false if the rays do not meet
/// within the gate, the sizes contradict or the IDs do.
bool MakeCandidate(const Rig& rig, std::span<const CameraTargets> cameras,
                   const std::vector<int>& target, const MatchingOptions& options,
                   Candidate* candidate);

}  // namespace videogrammetry
