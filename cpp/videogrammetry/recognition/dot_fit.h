#pragma once

#include <optional>
#include <vector>

#include "videogrammetry/recognition/dot_fit_kernels.h"
#include "videogrammetry/recognition/ellipse_fit.h"
#include "videogrammetry/recognition/grey_window.h"
#include "videogrammetry/recognition/model_fit.h"

namespace videogrammetry {

/// Where a fit begins: good to a fraction of the blur.
struct DotStart {
  EllipseFrame frame;
  double inside = 0.0, outside = 0.0;  ///< grey values, with the polarity's sign
};

/// E of the ellipse whose inside has the second moments V: 2 sqrt(V).
/// @return nullopt if V is not positive definite.
std::optional<Eigen::Matrix2d> ShapeOfMoments(double var_xx, double var_xy, double var_yy);

/// Fits the grey values of a dot by those of a blurred ellipse, fast.
///
/// The model of model_fit.h, Eqs. (1) to (3), with light that multiplies:
///
///     I(p) = (out + (in - out) F(z)) (1 + g . v),   v = E_0^-1 (p - c_0).   (4)
///
/// Ten unknowns: in, out, g (2), the blur s, E (3), c (2). g and s are held by
/// the picture's priors. Sixteen pixels at a time in float arithmetic, sums
/// solved in double: 1 us for a dot of 12 px. What (4) does not hold, glare and
/// things that cover a part of the dot, is for FitModel; `variance_factor` and
/// `misfit` show it.
class DotFitter {
 public:
  explicit DotFitter(InstructionSet set = DetectInstructionSet());

  /// The ellipse with the second moments of the dot's grey values, less those of the
  /// blur: good to some hundredths of a pixel however the ellipse was cut out.
  ///
  /// @return nullopt if there is no such ellipse, or one far from the start.
  std::optional<DotStart> Begin(const GreyWindow& window, const DotStart& start, double blur_px);

  /// @param window  covers the ellipse and `Reach` around it, or what the
  ///     picture has of that.
  /// @param picture  nullptr: all pixels weigh the same, s is nearly free.
  /// @param pool  fill in what PoolModels and PoolGradient want as well.
  /// @return nullopt if the iteration fails or leaves the start.
  std::optional<ModelFit> Fit(const GreyWindow& window, const DotStart& start,
                              const PictureModel* picture, bool pool = false);

  /// How far around an ellipse pixels are used, at most.
  static double Reach(double blur_px);
  /// Blur that is expected of a camera of which nothing is known.
  static constexpr double kUsualBlurPx = 0.75;

 private:
  const dot_fit::Kernels* kernels_;
  std::vector<float> pixels_, rows_;  ///< kept from one dot to the next
};

}  // namespace videogrammetry
