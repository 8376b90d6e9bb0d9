#pragma once

#include <vector>

#include "videogrammetry/adjustment/network.h"

namespace videogrammetry {

/// Which unknowns are eliminated from the normal equations, in blocks that no
/// observation joins with each other, and which stand in the reduced vector.
///
/// Either the points (three unknowns; up to four that scale bars join
/// are one block) or the inner poses (six), whichever leaves the smaller vector.
/// Points of the prior block and of larger groups stay in it.
struct Elimination {
  enum class What { kSmallest, kPoints, kPoses };

  Elimination(const Network& network, const UnknownIndex& index, What what = What::kSmallest);

  std::vector<int> reduced;              ///< the reduced vector's unknowns, ascending
  std::vector<std::vector<int>> blocks;  ///< each block's unknowns
  std::vector<int> block_of;             ///< of an unknown; -1 = in the reduced vector
  std::vector<int> place;                ///< of an unknown in its block or the reduced vector
};

}  // namespace videogrammetry
