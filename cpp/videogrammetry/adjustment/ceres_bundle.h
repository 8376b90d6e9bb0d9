#pragma once

#include "videogrammetry/adjustment/bundle.h"
#include "videogrammetry/adjustment/network.h"

namespace videogrammetry {

/// As SolveBundle, with Ceres' Levenberg-Marquardt and its step control: for starts that
/// are too far off for SolveNormalEquations. Every used observation must have a picture.
BundleSummary SolveWithCeres(Network* network, const BundleOptions& options);

}  // namespace videogrammetry
