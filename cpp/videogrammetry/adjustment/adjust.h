#pragma once

#include <string>
#include <vector>

#include "videogrammetry/adjustment/dispersion.h"
#include "videogrammetry/adjustment/significance.h"
#include "videogrammetry/adjustment/variance.h"

namespace videogrammetry {

/// What an adjustment does beside minimising.
struct AdjustOptions {
  /// Critical value of the test of one observation, a normal deviate; 0 = no data snooping.
  double critical_value = 3.29;
  /// Estimate an additive variance of the image points per camera.
  bool estimate_floor = true;
  /// Start robustly (Cauchy's loss, floors from medians) before least squares.
  bool robust_start = true;
  /// Drop offered distortion parameters below this many standard deviations; 0 = keep all.
  double significance = 0.0;
  /// Per camera, which parameters may be dropped; empty = none.
  std::vector<CameraMask> offered;
  /// True: the standard deviations are those stated (Baarda's w-test). False:
  /// sigma0 is estimated from the network itself (Pope's tau).
  bool baarda = true;
  /// Adjustments between the changes of weights and observations, at most.
  int max_rounds = 30;
  /// 0 = one a core.
  int num_threads = 0;
};

/// Summary of an adjustment; the network itself holds the values.
struct AdjustResult {
  bool converged = false;
  std::string message;
  double sigma0 = 1.0;
  int num_observations = 0;  ///< image coordinates used
  int num_prior = 0;         ///< coordinates observed a priori
  int num_unknowns = 0;
  int redundancy = 0;
  /// Variance factor of the weighted points' coordinates and their redundancy.
  double point_factor = 1.0;
  double point_redundancy = 0.0;
  /// The same of the scale bars.
  double bar_factor = 1.0;
  double bar_redundancy = 0.0;
  std::vector<CameraVariance> cameras;
  std::vector<ObservationStatistics> statistics;
  std::vector<PointStatistics> points;  ///< of the a-priori positions
  std::vector<BarStatistics> bars;
  std::vector<DroppedParameter> dropped;
  int rounds = 0;
};

/// Adjusts the network: robust start, then least squares with data snooping,
/// variance components and (where asked for) a test of the interior
/// parameters, until none of them changes anything.
///
/// @throws AdjustmentError on rank defect or if the redundancy is not positive.
AdjustResult Adjust(Network* network, const AdjustOptions& options);

}  // namespace videogrammetry
