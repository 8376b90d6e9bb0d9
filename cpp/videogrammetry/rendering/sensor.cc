#include "videogrammetry/rendering/sensor.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "videogrammetry/rendering/random.h"

namespace videogrammetry {
namespace {

constexpr int kCells = 4096;
constexpr std::uint32_t kOuterCells = 16;

/// Inverse of the standard normal distribution.
///
/// P. J. Acklam, An algorithm for computing the inverse normal cumulative
/// distribution function (2003): rational functions of two regions.
double InverseNormal(double p) {
  constexpr double a[] = {-3.969683028665376e+01, 2.209460984245205e+02,  -2.759285104469687e+02,
                          1.383577518672690e+02,  -3.066479806614716e+01, 2.506628277459239e+00};
  constexpr double b[] = {-5.447609879822406e+01, 1.615858368580409e+02, -1.556989798598866e+02,
                          6.680131188771972e+01, -1.328068155288572e+01};
  constexpr double c[] = {-7.784894002430293e-03, -3.223964580411365e-01, -2.400758277161838e+00,
                          -2.549732539343734e+00, 4.374664141464968e+00,  2.938163982698783e+00};
  constexpr double d[] = {7.784695709041462e-03, 3.224671290700398e-01, 2.445134137142996e+00,
                          3.754408661907416e+00};
  if (p > 0.5) return -InverseNormal(1 - p);
  if (p < 0.02425) {
    const double q = std::sqrt(-2 * std::log(p));
    return (((((c[0] * q + c[1]) * q + c[2]) * q + c[3]) * q + c[4]) * q + c[5]) /
           ((((d[0] * q + d[1]) * q + d[2]) * q + d[3]) * q + 1);
  }
  const double q = p - 0.5, r = q * q;
  return (((((a[0] * r + a[1]) * r + a[2]) * r + a[3]) * r + a[4]) * r + a[5]) * q /
         (((((b[0] * r + b[1]) * r + b[2]) * r + b[3]) * r + b[4]) * r + 1);
}

using Quantiles = std::array<float, kCells + 1>;

const Quantiles& TableOfQuantiles() {
  static const Quantiles table = [] {
    Quantiles q{};
    for (int k = 1; k < kCells; ++k) {
      q[k] = static_cast<float>(InverseNormal(static_cast<double>(k) / kCells));
    }
    return q;
  }();
  return table;
}

inline float NormalOf(std::uint32_t bits, const Quantiles& table) {
  const std::uint32_t cell = bits >> 20;
  if (cell - kOuterCells >= kCells - 2 * kOuterCells) {
    return static_cast<float>(InverseNormal((bits + 0.5) * 0x1p-32));
  }
  const float low = table[cell];
  return low + (table[cell + 1] - low) * (static_cast<float>(bits & 0xfffffu) * 0x1p-20f);
}

/// One mixed number serves two neighbouring pixels.
inline std::uint64_t PairBits(std::uint64_t key, std::size_t pair) { return MixedBits(key + pair); }

template <typename T>
T Sample(float grey, float full_scale) {
  return static_cast<T>(std::clamp(grey, 0.0f, full_scale) + 0.5f);
}

}  // namespace

float StandardNormal(std::uint64_t seed, std::size_t index) {
  const std::uint64_t bits = PairBits(MixedBits(seed), index / 2);
  return NormalOf(static_cast<std::uint32_t>(index % 2 == 0 ? bits : bits >> 32),
                  TableOfQuantiles());
}

template <typename T>
void ReadOut(const float* light, std::size_t count, const Sensor& sensor, std::uint64_t seed,
             T* samples) {
  const auto full = static_cast<float>(sensor.full_scale());
  if (sensor.read_noise == 0 && sensor.shot_noise_gain == 0) {
    for (std::size_t i = 0; i < count; ++i) samples[i] = Sample<T>(light[i] * full, full);
    return;
  }
  const auto variance = static_cast<float>(sensor.read_noise * sensor.read_noise);
  const auto gain = static_cast<float>(sensor.shot_noise_gain);
  const std::uint64_t key = MixedBits(seed);
  const Quantiles& table = TableOfQuantiles();
  const auto noisy = [&](float share, std::uint32_t bits) {
    const float grey = share * full;
    const float sigma = std::sqrt(variance + gain * std::max(grey, 0.0f));
    return Sample<T>(grey + sigma * NormalOf(bits, table), full);
  };
  for (std::size_t i = 0; i + 1 < count; i += 2) {
    const std::uint64_t bits = PairBits(key, i / 2);
    samples[i] = noisy(light[i], static_cast<std::uint32_t>(bits));
    samples[i + 1] = noisy(light[i + 1], static_cast<std::uint32_t>(bits >> 32));
  }
  if (count % 2 == 1) {
    const std::uint64_t bits = PairBits(key, count / 2);
    samples[count - 1] = noisy(light[count - 1], static_cast<std::uint32_t>(bits));
  }
}

template void ReadOut(const float*, std::size_t, const Sensor&, std::uint64_t, std::uint8_t*);
template void ReadOut(const float*, std::size_t, const Sensor&, std::uint64_t, std::uint16_t*);

}  // namespace videogrammetry
