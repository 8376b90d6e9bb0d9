#include "videogrammetry/adjustment/bundle.h"

#include "videogrammetry/adjustment/ceres_bundle.h"
#include "videogrammetry/adjustment/gauss_newton.h"
#include "videogrammetry/adjustment/observation_model.h"

namespace videogrammetry {

BundleSummary SolveBundle(Network* network, const BundleOptions& options) {
  network->Check();
  for (NetworkObservation& o : network->observations) {
    o.used = o.used && PredictImagePoint(*network, o.image, o.point, o.velocity_px).has_value();
  }
  if (const auto solved = SolveNormalEquations(network, options)) return *solved;
  return SolveWithCeres(network, options);
}

}  // namespace videogrammetry
