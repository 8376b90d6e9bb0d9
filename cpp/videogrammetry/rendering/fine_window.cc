#include "videogrammetry/rendering/fine_window.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace videogrammetry {
namespace {

/// Where the Gaussian is cut off: 2e-5 of it lies beyond.
constexpr double kReach = 4.3;

int ScaleFor(double sigma_px) {
  if (sigma_px <= 0) return 1;
  if (sigma_px >= 0.6) return 2;
  return sigma_px >= 0.3 ? 4 : 8;
}

/// Gaussian at the distances j * step, j = -count ... count, of sum 1.
std::vector<double> SampledGaussian(double sigma, double step, int count) {
  std::vector<double> g;
  double sum = 0;
  for (int j = -count; j <= count; ++j) {
    g.push_back(sigma > 0 ? std::exp(-0.5 * j * j * step * step / (sigma * sigma)) : j == 0);
    sum += g.back();
  }
  for (double& v : g) v /= sum;
  return g;
}

/// Integral over [begin, end] of the pixel's square convolved with the Gaussian.
double PixelShare(double sigma, double begin, double end) {
  if (sigma <= 0) return end - begin;  // cells of the pixel itself
  constexpr int kParts = 64;
  double sum = 0;
  for (int i = 0; i < kParts; ++i) {
    const double x = begin + (end - begin) * (i + 0.5) / kParts, root = sigma * std::numbers::sqrt2;
    sum += 0.5 * (std::erf((x + 0.5) / root) - std::erf((x - 0.5) / root));
  }
  return sum * (end - begin) / kParts;
}

}  // namespace

PsfKernel::PsfKernel(double psf_sigma_px) : scale_(ScaleFor(psf_sigma_px)) {
  radius_px_ = static_cast<int>(std::ceil(kReach * psf_sigma_px));
  const int reach = radius_px_ * scale_;
  std::vector<double> taps(static_cast<std::size_t>(2 * reach + scale_));
  double sum = 0;
  for (std::size_t k = 0; k < taps.size(); ++k) {
    const double begin =
        (static_cast<double>(k) - reach) / scale_ - 0.5;  // from the pixel's centre
    taps[k] = PixelShare(psf_sigma_px, begin, begin + 1.0 / scale_);
    sum += taps[k];
  }
  for (const double tap : taps) taps_.push_back(static_cast<float>(tap / sum));
}

void PsfKernel::AddBlurred(const PixelWindow& window, const std::vector<float>& cells, int width,
                           int height, float* picture) const {
  const int r = radius_px_, s = scale_, taps = static_cast<int>(taps_.size());
  const PixelWindow out{std::max(window.x0 - r, 0), std::max(window.y0 - r, 0),
                        std::min(window.x1 + r, width), std::min(window.y1 + r, height)};
  if (out.empty()) return;
  const int columns = window.width() * s, rows = window.height() * s;
  // Each of the s phases of a column-wise blurred row, with 2 r pixels of nothing on both sides.
  const int phase_length = window.width() + 4 * r;
  std::vector<float> line(static_cast<std::size_t>(columns));
  std::vector<float> phases(static_cast<std::size_t>(phase_length) * s, 0.0f);
  std::vector<float> sum(static_cast<std::size_t>(out.width()));
  for (int y = out.y0; y < out.y1; ++y) {
    const int first = (y - r - window.y0) * s;
    std::fill(line.begin(), line.end(), 0.0f);
    for (int k = std::max(0, -first); k < std::min(taps, rows - first); ++k) {
      const float tap = taps_[k];
      const float* row = cells.data() + static_cast<std::size_t>(first + k) * columns;
      for (int i = 0; i < columns; ++i) line[i] += tap * row[i];
    }
    for (int p = 0; p < s; ++p) {
      float* phase = phases.data() + p * phase_length + 2 * r;
      for (int i = 0; i < window.width(); ++i) phase[i] = line[i * s + p];
    }
    std::fill(sum.begin(), sum.end(), 0.0f);
    for (int k = 0; k < taps; ++k) {
      const float tap = taps_[k];
      const float* phase =
          phases.data() + (k % s) * phase_length + 2 * r + (out.x0 - r - window.x0) + k / s;
      for (int i = 0; i < out.width(); ++i) sum[i] += tap * phase[i];
    }
    float* target = picture + static_cast<std::size_t>(y) * width + out.x0;
    for (int i = 0; i < out.width(); ++i) target[i] += sum[i];
  }
}

void BlurPixels(double sigma_px, int width, int height, std::vector<float>* picture) {
  if (sigma_px <= 0) return;
  const int r = static_cast<int>(std::ceil(kReach * sigma_px));
  const std::vector<double> g = SampledGaussian(sigma_px, 1.0, r);
  std::vector<float> line(static_cast<std::size_t>(std::max(width, height) + 2 * r));
  std::vector<float> rows(picture->size(), 0.0f);
  for (int y = 0; y < height; ++y) {  // down the columns, row by row
    float* out = rows.data() + static_cast<std::size_t>(y) * width;
    for (int k = -r; k <= r; ++k) {
      const float tap = static_cast<float>(g[k + r]);
      const float* in =
          picture->data() + static_cast<std::size_t>(std::clamp(y + k, 0, height - 1)) * width;
      for (int x = 0; x < width; ++x) out[x] += tap * in[x];
    }
  }
  for (int y = 0; y < height; ++y) {
    const float* in = rows.data() + static_cast<std::size_t>(y) * width;
    for (int x = -r; x < width + r; ++x) line[x + r] = in[std::clamp(x, 0, width - 1)];
    float* out = picture->data() + static_cast<std::size_t>(y) * width;
    std::fill(out, out + width, 0.0f);
    for (int k = 0; k <= 2 * r; ++k) {
      const float tap = static_cast<float>(g[k]);
      for (int x = 0; x < width; ++x) out[x] += tap * line[x + k];
    }
  }
}

}  // namespace videogrammetry
