#include "videogrammetry/recognition/gradient_threshold.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "videogrammetry/recognition/edge_pair_samples.h"

namespace videogrammetry {
namespace {

int Quantile(std::vector<int>& values, double fraction) {
  const auto index = static_cast<std::ptrdiff_t>(fraction * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + index, values.end());
  return values[static_cast<std::size_t>(index)];
}

// The smallest value that more than `fraction` of the values do not exceed, by bisection.
int Quantile(const edge_pair::Kernels& kernels, const std::vector<std::uint16_t>& values,
             double fraction) {
  const int size = static_cast<int>(values.size());
  const int index = static_cast<int>(fraction * (size - 1));
  int low = 0, high = 65535;
  while (low < high) {
    const int middle = (low + high) / 2;
    if (kernels.count_up_to(values.data(), size, static_cast<std::uint16_t>(middle)) > index) {
      high = middle;
    } else {
      low = middle + 1;
    }
  }
  return low;
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

GreyStatistics SampleGreyStatistics(const FrameView& frame, InstructionSet set) {
  const edge_pair::SampleRows rows(frame, 1, set);
  if (rows.width < 3 || rows.height < 1) return {};
  // Pieces of kPiece samples, shifted from row to row so that they do not all stand in
  // the same columns: golden section of the row's length.
  constexpr int kPiece = 32, kPerRow = 4, kRows = 64;
  constexpr double kGolden = 0.6180339887498949;
  const int piece = std::min(kPiece, rows.width - 2), gaps = rows.width - piece - 2;
  const int num_rows = std::min(kRows, rows.height);
  std::vector<std::uint16_t> values(static_cast<std::size_t>(piece * kPerRow * num_rows));
  std::vector<std::uint16_t> gradients(values.size());
  std::uint16_t samples[kPiece + 2 + edge_pair::kSampleSlack];
  std::size_t at = 0;
  for (int k = 0; k < kPerRow * num_rows; ++k) {
    const int y =
        static_cast<int>((2 * std::int64_t{k / kPerRow} + 1) * rows.height / (2 * num_rows));
    const double turns = kGolden * k;
    const int x = static_cast<int>(gaps * (turns - static_cast<int>(turns))) & ~1;
    rows.Read(x, y, piece + 2, samples);
    for (int i = 0; i < piece; ++i, ++at) {
      values[at] = samples[i + 1];
      gradients[at] = static_cast<std::uint16_t>(std::abs(samples[i + 2] - samples[i]));
    }
  }
  const edge_pair::Kernels& kernels = *rows.kernels;
  return {Quantile(kernels, values, 0.001), Quantile(kernels, values, 0.999),
          Quantile(kernels, gradients, 0.5)};
}

int GradientThreshold(const GreyStatistics& statistics) {
  const double range = statistics.high - statistics.low;
  const double noise = 4.0 * statistics.median_gradient / 0.6745;
  return std::max(3, static_cast<int>(std::lround(std::clamp(noise, 0.02 * range, 0.2 * range))));
}

int EdgeThreshold::At(int grey) const {
  const std::int64_t over = std::max(0, grey - from_grey);
  return least + static_cast<int>(std::min<std::int64_t>(most, over * per_grey >> 16));
}

EdgeThreshold ThresholdByNoise(int least, const GreyNoise& noise, int sign) {
  EdgeThreshold threshold = least;
  const double per_grey = sign * noise.per_grey, square = static_cast<double>(least) * least / 32.0;
  if (!(per_grey > 0.0)) return threshold;
  // Var(from) = T^2 / 32, and 4 T^2 / 32 where the line has 2 T.
  const double from = std::ceil((square - noise.at_zero) / per_grey);
  if (from >= 65535.0) return threshold;
  threshold.from_grey = static_cast<int>(std::max(0.0, from));
  const double slope = 65536.0 * least * per_grey / (3.0 * square);
  threshold.per_grey = static_cast<int>(std::clamp(slope, 0.0, 65535.0));
  threshold.most = std::min(65535, 2 * least);
  return threshold;
}

template GreyStatistics MeasureGreyStatistics(const ImageView<std::uint8_t>&);
template GreyStatistics MeasureGreyStatistics(const ImageView<std::uint16_t>&);

}  // namespace videogrammetry
