#pragma once

#include <vector>

#include "videogrammetry/matching/candidates.h"

namespace videogrammetry {

/// The stage's statistics given the candidates' probabilities: what one step of
/// expectation maximisation makes of them.
///
/// Points a mm^3: their expected number over the box that holds them. Lone
/// targets: those that belong to no candidate, over the part of the picture that has their
/// moments: where a common volume fills half of it, they are twice as dense as over all of it.
/// Detections: of the points that two cameras besides c prove, c being in view, the share that c
/// has a target of, camera by camera that they are proven by - so cameras on opposite sides of an
/// object come out as seeing none of each other's points.
///
/// @param known  matches that are certain (coded ones), probability 1.
StageStatistics EstimateStatistics(const std::vector<CameraView>& cameras,
                                   const std::vector<TargetView>& targets,
                                   const std::vector<Candidate>& candidates,
                                   const std::vector<Candidate>& known,
                                   const StageStatistics& before);

}  // namespace videogrammetry
