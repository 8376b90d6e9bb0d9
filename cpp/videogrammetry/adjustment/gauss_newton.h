#pragma once

#include <optional>

#include "videogrammetry/adjustment/bundle.h"

namespace videogrammetry {

/// Minimises as SolveBundle does, by damped Gauss-Newton steps
/// (N + damping diag N) dx = A'Pv on the normal equations with blocks eliminated.
///
/// Nothing but the normal equations is formed, of which the reduced ones are dense: several
/// times faster than a general solver. It stops where a step promises to lower v'Pv by less
/// than the function tolerance of it, or by 1e-16: dx'N dx is twice that, so that no
/// unknown would move by more than 1e-7 of its standard deviation.
///
/// @return nullopt, with the network as it was, where the steps do not lead downwards as the
///     normal equations promise, or these are singular.
std::optional<BundleSummary> SolveNormalEquations(Network* network, const BundleOptions& options);

}  // namespace videogrammetry
