#pragma once

#include <Eigen/Core>

namespace videogrammetry {

/// u' Q^-1 u over the directions in which Q exceeds `share` of `scale`: of an a-priori
/// position that nothing else checks in a direction, this direction is not tested.
double QuadraticForm(const Eigen::Vector3d& u, const Eigen::Matrix3d& q,
                     const Eigen::Matrix3d& scale, double share);

/// The |w| whose probability under the normal distribution, 2 (1 - Phi(w)), is
/// that of a chi-square with three degrees of freedom above `chi_square`.
double EquivalentDeviate(double chi_square);

/// Critical value of Pope's tau, for residuals divided by their standard
/// deviation with the sigma0 that they themselves estimate, at the same
/// probability of error as `critical_value` of a normal deviate [1, 2]:
///   tau = t sqrt(r) / sqrt(r - 1 + t^2),  t: Student's with r - 1 degrees.
/// Infinite where the redundancy r is below 2.
///
/// [1] A. Pope, The statistics of residuals and the detection of outliers,
///     NOAA TR NOS 65 NGS 1, 1976.  [2] B. Heck, AVN 88 (1981), 17-34.
double PopeTau(double critical_value, int redundancy);

/// Student's t with P(|T| > t) = P(|N| > critical_value).
double StudentQuantile(double critical_value, int degrees);

}  // namespace videogrammetry
