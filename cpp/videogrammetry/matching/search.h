#pragma once

#include <vector>

#include "videogrammetry/matching/candidates.h"

namespace videogrammetry {

/// All candidates among the free targets whose score is not hopeless.
///
/// Seeds are the pairs of targets whose rays meet; a seed grows by what the other cameras
/// have at its point's picture. Where one has several, or one that says little, each is tried
/// and none; of sets that claim the same target the parts without it are candidates too.
/// Pairs of cameras go one after another, a pair's seeds in blocks of fixed size: the result
/// does not depend on `num_threads` (0: one a core).
std::vector<Candidate> FindCandidates(const CandidateMaker& maker, const PairFinder& pairs,
                                      const FreeTargets& free, const StageStatistics& statistics,
                                      int num_threads);

}  // namespace videogrammetry
