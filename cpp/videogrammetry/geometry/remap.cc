#include "videogrammetry/geometry/remap.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

#include "videogrammetry/core/thread_pool.h"

namespace videogrammetry {
namespace {

/// Weights of the samples at 1 - kTaps / 2 ... kTaps / 2 around a place that
/// lies `t` in [0, 1) behind sample 0.
struct Linear {
  static constexpr int kTaps = 2;
  static std::array<double, kTaps> Weights(double t) { return {1 - t, t}; }
};

struct Cubic {
  static constexpr int kTaps = 4;
  static std::array<double, kTaps> Weights(double t) {  // Keys, Eq. (15)
    const double t2 = t * t, t3 = t2 * t;
    return {0.5 * (2 * t2 - t - t3), 1 + 0.5 * (3 * t3 - 5 * t2), 0.5 * (t + 4 * t2 - 3 * t3),
            0.5 * (t3 - t2)};
  }
};

struct Lanczos {
  static constexpr int kTaps = 6;
  static std::array<double, kTaps> Weights(double t) {
    if (t < 1e-9) return {0, 0, 1, 0, 0, 0};
    // sinc(d) sinc(d / 3), d = k - t: |sin(pi d)| is the same for all k, and only the
    // ratio of the weights counts.
    std::array<double, kTaps> weights;
    double sum = 0;
    for (int i = 0; i < kTaps; ++i) {
      const double d = i - 2 - t;
      const double sign = i % 2 == 0 ? 1.0 : -1.0;
      weights[static_cast<std::size_t>(i)] = sign * std::sin(std::numbers::pi * d / 3) / (d * d);
      sum += weights[static_cast<std::size_t>(i)];
    }
    double moved = 0;  // of the centre of the weights from the place: a plane would be shifted
    for (int i = 0; i < kTaps; ++i) {
      weights[static_cast<std::size_t>(i)] /= sum;
      moved += weights[static_cast<std::size_t>(i)] * (i - 2 - t);
    }
    weights[2] += moved;
    weights[3] -= moved;
    return weights;
  }
};

template <typename Kernel, typename T>
double Sample(const ImageView<T>& source, double x, double y) {
  constexpr int kTaps = Kernel::kTaps;
  const double column = std::floor(x), row = std::floor(y);
  const auto across = Kernel::Weights(x - column), down = Kernel::Weights(y - row);
  const int left = static_cast<int>(column) + 1 - kTaps / 2;
  const int top = static_cast<int>(row) + 1 - kTaps / 2;
  const bool inside =
      left >= 0 && top >= 0 && left + kTaps <= source.width() && top + kTaps <= source.height();
  double value = 0;
  for (int i = 0; i < kTaps; ++i) {
    const T* samples = source.row(inside ? top + i : std::clamp(top + i, 0, source.height() - 1));
    double sum = 0;
    for (int k = 0; k < kTaps; ++k) {
      const int at = inside ? left + k : std::clamp(left + k, 0, source.width() - 1);
      sum += across[static_cast<std::size_t>(k)] * samples[at];
    }
    value += down[static_cast<std::size_t>(i)] * sum;
  }
  return value;
}

template <typename Kernel, typename T>
void RemapRow(const ImageView<T>& source, const double* places, int width,
              const RemapOptions& options, T* out) {
  const double right = source.width() - 0.5, bottom = source.height() - 0.5;
  for (int i = 0; i < width; ++i) {
    const double x = places[2 * i], y = places[2 * i + 1];
    // Written so that NaN is outside.
    if (!(x >= -0.5 && x < right && y >= -0.5 && y < bottom)) {
      out[i] = static_cast<T>(options.fill);
      continue;
    }
    const double value =
        std::clamp(Sample<Kernel>(source, x, y), 0.0, static_cast<double>(options.largest));
    out[i] = static_cast<T>(value + 0.5);
  }
}

void CheckGrey(const char* name, int value, int most) {
  if (value < 0 || value > most) {
    throw std::invalid_argument(std::string(name) + ": expected 0 to " + std::to_string(most) +
                                ", got " + std::to_string(value));
  }
}

}  // namespace

template <typename T>
void Remap(const ImageView<T>& source, const double* map_px, int width, int height,
           const RemapOptions& options, T* out) {
  if (source.width() < 1 || source.height() < 1) {
    throw std::invalid_argument("source: expected a picture of one pixel or more");
  }
  CheckGrey("fill", options.fill, std::numeric_limits<T>::max());
  CheckGrey("largest", options.largest, std::numeric_limits<T>::max());
  ParallelFor(height, options.num_threads, [&](int y) {
    const std::ptrdiff_t start = static_cast<std::ptrdiff_t>(y) * width;
    const double* places = map_px + 2 * start;
    switch (options.interpolation) {
      case Interpolation::kLinear:
        return RemapRow<Linear>(source, places, width, options, out + start);
      case Interpolation::kCubic:
        return RemapRow<Cubic>(source, places, width, options, out + start);
      case Interpolation::kLanczos:
        return RemapRow<Lanczos>(source, places, width, options, out + start);
    }
  });
}

template void Remap(const ImageView8&, const double*, int, int, const RemapOptions&, std::uint8_t*);
template void Remap(const ImageView16&, const double*, int, int, const RemapOptions&,
                    std::uint16_t*);

}  // namespace videogrammetry
