#pragma once

#include <vector>

#include "videogrammetry/adjustment/dispersion.h"

namespace videogrammetry {

/// One round's decisions of the data snooping.
struct SnoopingChange {
  int rejected = 0;
  int readmitted = 0;
};

/// Data snooping (Baarda's w-test), one round: rejects image points whose |w|
/// in a coordinate exceeds the critical value, the largest first and only one
/// a picture and one an object point, because an outlier spoils its neighbours'
/// residuals; re-admits rejected ones that fit again. Of a picture with more
/// than half of its points beyond the critical value, all those go at once.
///
/// @param rounds_out  how often each observation has been rejected so far; one
///     that was re-admitted and rejected again stays out. Size of `observations`.
SnoopingChange SnoopOnce(Network* network, const std::vector<ObservationStatistics>& statistics,
                         double critical_value, std::vector<int>* rounds_out);

/// The same of the scale bars and the points' a-priori positions, a point's three
/// coordinates together: rejects the one with the largest |w|, re-admits
/// what fits again. Nothing is rejected while an image point has a larger |w|.
///
/// @param bar_rounds_out, point_rounds_out  as above, of the bars and of the points.
SnoopingChange SnoopPriorsOnce(Network* network,
                               const std::vector<ObservationStatistics>& statistics,
                               const std::vector<BarStatistics>& bars,
                               const std::vector<PointStatistics>& points, double critical_value,
                               std::vector<int>* bar_rounds_out,
                               std::vector<int>* point_rounds_out);

}  // namespace videogrammetry
