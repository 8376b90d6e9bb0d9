#pragma once

#include <Eigen/Core>
#include <optional>

#include "videogrammetry/recognition/signed_image.h"
#include "videogrammetry/recognition/target_edge.h"

namespace videogrammetry {

/// Variance of a grey value, linear in it (shot noise over a constant part).
struct GreyNoise {
  double at_zero = 1.0;
  double per_grey = 0.0;
  double least = 1.0 / 12.0;  ///< of rounding

  double Variance(double grey) const {
    const double variance = at_zero + per_grey * grey;
    return variance > least ? variance : least;
  }
};

/// What the dots of one picture have in common.
struct PictureModel {
  GreyNoise noise;
  double blur_px = 0.0;        ///< standard deviation of the blur, pixel included
  double blur_sigma_px = 0.0;  ///< how much it differs from dot to dot
  /// Standard deviation of what light changes over a radius, in units of the contrast.
  double gradient = 0.02;
  /// The same of light that is added on the darker side of the edge.
  double flare = 0.004;
};

/// A dot's grey values, fitted.
struct ModelFit {
  Ellipse ellipse;
  Eigen::Matrix<double, 5, 5> cov = Eigen::Matrix<double, 5, 5>::Zero();
  double blur_px = 0.0, blur_sigma_px = 0.0;
  double inside = 0.0, outside = 0.0;  ///< grey values of the plateaus at the centre
  /// Variances of the residuals: of all, and on both plateaus where there are pixels enough.
  double variance = 0.0;
  std::optional<double> inside_variance, outside_variance;
  /// Gradient of the brighter side as the pixels alone have it, and the variance
  /// of either coordinate, in units of the contrast. Empty if the dot has glare.
  std::optional<Eigen::Vector2d> gradient;
  double gradient_variance = 0.0;
  double variance_factor = 1.0;  ///< a posteriori: weighted square sum over its degrees of freedom
  double plain_factor = 1.0;     ///< the same, outliers at full weight (DotFitter alone)
  int pixels = 0;                ///< that were looked at
};

/// Fits the grey values around a dot's contour by those of a blurred ellipse.
///
///     I(p) = out(p) + (in(p) - out(p)) F(z),   z = (d - delta) / s',      (1)
///     in(p) = m1 + g1 . v,  out(p) = m2 + g2 . v,  v = E^-1 (p - c)
///
/// d is the distance of the pixel's centre p inward from the ellipse, from its
/// nearest point. The blur's variance s^2 holds the pixel's box (1/12 px^2, in
/// every direction). An edge of curvature k that is blurred moves towards the
/// centre of curvature and widens: with the contour y = -k x^2 / 2 - k^3 x^4 / 8
/// and x normal of variance s^2
///
///     delta = k s^2 / 2 + 3 k^3 s^4 / 8,   s'^2 = s^2 (1 + k^2 s^2 / 2).  (2)
///
/// F is the normal distribution with the box's fourth cumulant along the
/// normal n, -(n_x^4 + n_y^4) / 120 px^4 (Edgeworth's first term).     (3)
///
/// Gauss-Newton on the ellipse (EllipseFrame), m1, g1, m2, g2 and s, on the
/// pixels up to 3 s + 1.5 px inside the contour and as far outside, but not
/// within 2.5 s of where a ring of code may begin, a radius away (small dots need
/// 2 s of ground all the same, or their gradients are not known). The gradients
/// are held by priors: light multiplies and seldom changes by more than 2 % of
/// the contrast over a radius, how much in a picture its dots say together; what
/// is added, glare (TargetEdge), frees them.
/// Weights are 1 / variance of the noise, with Huber's limit at 4 deviations.
///
/// @param picture  nullptr: all pixels weigh the same, s is free.
/// @return nullopt if the iteration fails or leaves the start.
template <typename T>
std::optional<ModelFit> FitModel(const SignedImage<T>& image, const TargetEdge& start,
                                 const PictureModel* picture);

/// Whether a fit is too far from where it began: it has found something else.
bool HasLeft(const Ellipse& start, const Ellipse& fitted);

}  // namespace videogrammetry
