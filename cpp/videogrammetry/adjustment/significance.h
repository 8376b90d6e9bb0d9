#pragma once

#include <vector>

#include "videogrammetry/adjustment/dispersion.h"

namespace videogrammetry {

/// A camera's parameter that is no longer estimated, and why.
struct DroppedParameter {
  int camera = 0;
  int parameter = 0;  ///< InteriorIndex or CameraUnknown
  double value = 0.0;
  double sigma = 0.0;
  /// True: not determined by the observations; false: not significant.
  bool undetermined = false;
};

/// Backward elimination of the parameters (distortion, aspect, time offset) that differ from their
/// start value (0 unless given) by less than `critical_value` of their
/// standard deviations.
///
/// The least significant goes first; the estimates and covariance of the rest
/// follow from the condition x_j = start_j on the normal equations,
///   x' = x - q_j (x_j - start_j) / q_jj,   Q' = Q - q_j q_j' / q_jj,
/// exact for the linearised problem, so no adjustment is run in between. A1
/// and A2 are not dropped while a higher A of the camera stays: the lower
/// order goes only after the higher.
///
/// @param offered  per camera, which parameters may be dropped (never f, x0, y0).
/// @param sigma0   a-posteriori factor on the dispersion.
/// @return what was dropped; `network` holds them at their start values, and
///     other values are the linear update's.
std::vector<DroppedParameter> DropInsignificant(Network* network, const Dispersion& dispersion,
                                                const std::vector<CameraMask>& offered,
                                                double sigma0, double critical_value);

/// f, x0 and y0 whose standard deviation exceeds what a camera's construction
/// leaves open (f: 10 % of itself; x0, y0: a quarter of the picture's larger
/// side) are not determined: the worst of each camera is set to its start value
/// and held.
std::vector<DroppedParameter> HoldUndetermined(Network* network, const Dispersion& dispersion,
                                               double sigma0);

}  // namespace videogrammetry
