#pragma once

#include "videogrammetry/adjustment/adjust.h"
#include "videogrammetry/adjustment/bundle.h"

namespace videogrammetry {

/// Start that outliers do not bend: Cauchy's loss on image points, scale bars
/// and a-priori positions, first with a wide floor and only f and A1, then
/// with all that is free. The floors of the image points are left as the
/// residuals' medians show them (zero where none are estimated). Of a free network
/// the scale bars take no part, for among wide image points they would bend it to a wrong
/// one: it ends in the scale that their median says.
BundleSummary RobustStart(Network* network, const AdjustOptions& options);

/// Sets aside what the robust start leaves beyond `limit` standard deviations:
/// a wrong number hundreds of pixels off would bend every least-squares fit so
/// far that the w-test points at good observations. The test re-admits what fits.
/// Without `baarda` the standard deviations are times the sigma0 that the
/// residuals' median shows.
void SetOutliersAside(Network* network, double limit, bool baarda);

}  // namespace videogrammetry
