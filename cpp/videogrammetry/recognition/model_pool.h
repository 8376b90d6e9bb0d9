#pragma once

#include <optional>
#include <vector>

#include "videogrammetry/recognition/model_fit.h"

namespace videogrammetry {

/// Noise and blur of a picture from the free fits of its dots: medians, the
/// blur's scatter from dot to dot beyond that of its noise. The gradient stays 2 %.
/// @return nullopt if there are no fits.
std::optional<PictureModel> PoolModels(const std::vector<ModelFit>& fits);

/// How even a picture's light is (PictureModel::gradient), from fits with its
/// noise: the t most likely a posteriori if the dots' gradients have the variance
/// t^2 + their noise, before the picture 2 % up to a factor of e.
double PoolGradient(const std::vector<ModelFit>& fits);

/// Measures dots anew by FitModel, first each for itself, then with the
/// picture's noise and blur, at last with the evenness of its light. A dot that
/// cannot be fitted stays as it was; edge_rms_px and width_px do for all.
template <typename T>
void RefineByModel(const SignedImage<T>& image, const std::vector<TargetEdge*>& edges);

}  // namespace videogrammetry
