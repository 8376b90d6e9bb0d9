#pragma once

#include <vector>

#include "videogrammetry/adjustment/dispersion.h"

namespace videogrammetry {

/// Variance component of one camera's image points.
struct CameraVariance {
  /// v'Pv / (sum of redundancy numbers): 1 where the stated covariances are true.
  double factor = 1.0;
  double redundancy = 0.0;
  double rms_px = 0.0;  ///< per coordinate, used observations
  int count = 0;        ///< used image points
};

/// Variance E[w^2 | |w| <= k] of a standard normal w that is cut off at k:
/// 1 - 2 k phi(k) / (2 Phi(k) - 1). Residuals that passed the w-test with the
/// critical value k have this variance, not 1. k = 0 means no test: 1.
double TruncatedVariance(double critical_value);

/// The variance components of all cameras from the present residuals.
std::vector<CameraVariance> CameraVariances(const Network& network,
                                            const std::vector<ObservationStatistics>& statistics);

/// What the residuals say about a camera's stated covariances.
struct CameraNoise {
  double floor_px = 0.0;
  double cov_scale = 1.0;
};

/// Floors c of all cameras, such that with the total covariance
/// cov_px2 + c^2 I every camera's v'Pv equals its sum of redundancy numbers
/// times TruncatedVariance(critical_value) (Foerstner's estimate of variance
/// components, one additive component a camera).
///
/// Where the stated covariances are too large instead, no floor can help: then
/// `cov_scale` is the factor that brings v'Pv there, so that image points and
/// target coordinates keep their true weight against each other.
///
/// 0 and 1 where the stated covariances explain the residuals within 2.58 standard
/// deviations of the factor, sqrt(2 / redundancy): what the residuals do not
/// demand must not change the weights.
std::vector<CameraNoise> EstimateNoise(const Network& network,
                                       const std::vector<ObservationStatistics>& statistics,
                                       double critical_value);

/// The same from the median of |v|, for residuals that hold outliers.
std::vector<double> RobustFloors(const Network& network,
                                 const std::vector<ObservationStatistics>& statistics);

}  // namespace videogrammetry
