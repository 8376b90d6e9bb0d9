#pragma once

#include <optional>

#include "videogrammetry/recognition/dot_fit.h"
#include "videogrammetry/recognition/grey_sampler.h"
#include "videogrammetry/recognition/grey_window.h"

namespace videogrammetry {

/// Grey values of a dot and its surroundings at sixteen places, whatever level it was
/// cut out at: the medians 0.6 minor axes inside and 1.25 or 2.25 px outside, where it is
/// darker (a dark rim may be narrow).
///
/// @param dot  its frame; its grey values are measured.
/// @return false unless it is brighter inside than outside all around; one place may fail.
///     And where the picture ends before one of them.
bool MeasureGrey(const GreySampler& picture, DotStart* dot);

/// The ellipse cut out at `level` as if cut at half height: of a blurred edge the part a is
/// reached s times the normal distribution's quantile of a inside of it, or
/// 0.59 s ln(a / (1 - a)).
void Resize(double level, double blur_px, DotStart* dot);

/// Light that is added on one side of a dot's edge, in units of the contrast.
struct FlareSample {
  /// Of the darker side's gradient over a radius, less its share of the light.
  double square = 0.0;
  double noise = 0.0;  ///< variance of either coordinate of that gradient
};

/// Flare as the planes through both plateaus have it.
/// @return nullopt if one of them is too small.
std::optional<FlareSample> MeasureFlare(const GreyWindow& window, const ModelFit& fit);

}  // namespace videogrammetry
