#pragma once

#include <vector>

#include "videogrammetry/adjustment/network.h"

namespace videogrammetry {

/// Holds every pose that sees fewer than four different points and every point
/// without a-priori position that fewer than two pictures see, and sets their
/// observations and scale bars aside for good: a stage whose pictures were all
/// rejected, or a point, must not make the normal equations singular.
///
/// @param rounds_out  of SnoopOnce; what is set aside gets a 2 and never comes back.
/// @return whether something was held: then call again, for it may starve others.
bool HoldStarved(Network* network, std::vector<int>* rounds_out, std::vector<int>* bar_rounds_out);

/// Sets a point aside like that.
void HoldPoint(Network* network, int point, std::vector<int>* rounds_out,
               std::vector<int>* bar_rounds_out);

}  // namespace videogrammetry
