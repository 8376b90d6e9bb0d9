#include "videogrammetry/recognition/model_pool.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "videogrammetry/core/median.h"

namespace videogrammetry {
namespace {

/// Standard deviation of the logarithm of a picture's gradient over the usual
/// one, and what the gradient is at least.
constexpr double kGradientSpread = 1.0, kLeastGradient = 0.001;

TargetEdge Updated(TargetEdge edge, const ModelFit& fit) {
  edge.ellipse = fit.ellipse;
  edge.cov = fit.cov;
  edge.inside = fit.inside;
  edge.outside = fit.outside;
  return edge;
}

GreyNoise PoolNoise(const std::vector<ModelFit>& fits) {
  std::vector<double> bright, bright_grey, dark, dark_grey, all;
  for (const ModelFit& fit : fits) {
    all.push_back(fit.variance);
    if (!fit.inside_variance || !fit.outside_variance) continue;
    bright.push_back(*fit.inside_variance);
    bright_grey.push_back(fit.inside);
    dark.push_back(*fit.outside_variance);
    dark_grey.push_back(fit.outside);
  }
  GreyNoise noise;
  if (bright.empty()) {  // dots too small for plateaus
    noise.at_zero = Median(all);
    return noise;
  }
  const double v1 = Median(bright), v0 = Median(dark);
  const double g1 = Median(bright_grey), g0 = Median(dark_grey);
  double slope = g1 > g0 ? (v1 - v0) / (g1 - g0) : 0.0;
  // Light's own noise grows with it, whatever the polarity's sign.
  if (slope * (std::abs(g1) - std::abs(g0)) < 0) slope = 0.0;
  noise.per_grey = slope;
  noise.at_zero = slope == 0.0 ? 0.5 * (v0 + v1) : v0 - slope * g0;
  noise.least = std::max(1.0 / 12.0, 0.3 * std::min(v0, v1));
  return noise;
}

}  // namespace

std::optional<PictureModel> PoolModels(const std::vector<ModelFit>& fits) {
  if (fits.empty()) return std::nullopt;
  std::vector<double> blur, blur_noise;
  for (const ModelFit& fit : fits) {
    blur.push_back(fit.blur_px);
    blur_noise.push_back(fit.blur_sigma_px * fit.blur_sigma_px);
  }
  PictureModel picture;
  picture.noise = PoolNoise(fits);
  picture.blur_px = Median(blur);
  std::vector<double> off;
  for (const double b : blur) off.push_back(std::abs(b - picture.blur_px));
  const double scatter = 1.4826 * Median(off);
  // Few dots know the common value no better than their own scatter says.
  const double own = Median(blur_noise);
  const double between = std::max(0.0, scatter * scatter - own);
  picture.blur_sigma_px =
      std::sqrt(between + 1.5 * own / static_cast<double>(blur.size()) + 0.003 * 0.003);
  return picture;
}

double PoolGradient(const std::vector<ModelFit>& fits) {
  constexpr double kRatio = 1.1, kMostSquares = 12.0;
  double best = PictureModel{}.gradient, least = 1e300;
  for (double t = kLeastGradient; t < 0.1; t *= kRatio) {
    const double off = std::log(t / PictureModel{}.gradient) / kGradientSpread;
    double cost = off * off;
    for (const ModelFit& fit : fits) {
      if (!fit.gradient) continue;
      const double variance = t * t + fit.gradient_variance;
      cost +=
          2.0 * std::log(variance) + std::min(kMostSquares, fit.gradient->squaredNorm() / variance);
    }
    if (cost < least) best = t;
    least = std::min(least, cost);
  }
  return best;
}

template <typename T>
void RefineByModel(const SignedImage<T>& image, const std::vector<TargetEdge*>& edges) {
  std::vector<TargetEdge> states;
  std::vector<TargetEdge*> fitted;
  std::vector<ModelFit> fits;
  for (TargetEdge* edge : edges) {
    const auto fit = FitModel(image, *edge, nullptr);
    if (!fit) continue;
    fitted.push_back(edge);
    states.push_back(Updated(*edge, *fit));
    fits.push_back(*fit);
  }
  auto picture = PoolModels(fits);
  if (!picture) return;
  // How even the light is shows with the noise known only: weights decide how
  // much of a gradient is noise.
  fits.clear();
  for (TargetEdge& state : states) {
    const auto fit = FitModel(image, state, &*picture);
    if (!fit) continue;
    state = Updated(state, *fit);
    fits.push_back(*fit);
  }
  picture->gradient = PoolGradient(fits);
  for (std::size_t k = 0; k < states.size(); ++k) {
    const auto fit = FitModel(image, states[k], &*picture);
    if (fit && !HasLeft(fitted[k]->ellipse, fit->ellipse)) *fitted[k] = Updated(*fitted[k], *fit);
  }
}

template void RefineByModel(const SignedImage<std::uint8_t>&, const std::vector<TargetEdge*>&);
template void RefineByModel(const SignedImage<std::uint16_t>&, const std::vector<TargetEdge*>&);

}  // namespace videogrammetry
