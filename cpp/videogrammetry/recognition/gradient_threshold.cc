#include "videogrammetry/recognition/gradient_threshold.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <vector>

namespace videogrammetry {
namespace {

int Quantile(std::vector<int>& values, double fraction) {
  const auto index = static_cast<std::ptrdiff_t>(fraction * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + index, values.end());
  return values[static_cast<std::size_t>(index)];
}

}  // namespace

template <typename T>
GreyStatistics MeasureGreyStatistics(const ImageView<T>& image) {
  if (image.width() < 3 || image.height() < 1) return {};
  constexpr int kSamples = 20000;
  constexpr int kColumnStep = 3;  // neighbours' differences share pixels
  const int columns = (image.width() - 2 + kColumnStep - 1) / kColumnStep;
  const int row_step = std::max(1, image.height() * columns / kSamples);
  std::vector<int> values, gradients;
  values.reserve(2 * kSamples);
  gradients.reserve(2 * kSamples);
  for (int y = row_step / 2; y < image.height(); y += row_step) {
    const T* row = image.row(y);
    for (int x = 1; x + 1 < image.width(); x += kColumnStep) {
      values.push_back(row[x]);
      gradients.push_back(std::abs(static_cast<int>(row[x + 1]) - static_cast<int>(row[x - 1])));
    }
  }
  return {Quantile(values, 0.001), Quantile(values, 0.999), Quantile(gradients, 0.5)};
}

int GradientThreshold(const GreyStatistics& statistics) {
  const double range = statistics.high - statistics.low;
  const double noise = 4.0 * statistics.median_gradient / 0.6745;
  return std::max(3, static_cast<int>(std::lround(std::clamp(noise, 0.02 * range, 0.2 * range))));
}

template GreyStatistics MeasureGreyStatistics(const ImageView<std::uint8_t>&);
template GreyStatistics MeasureGreyStatistics(const ImageView<std::uint16_t>&);

}  // namespace videogrammetry
