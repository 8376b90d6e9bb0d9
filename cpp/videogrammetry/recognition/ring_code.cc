#include "videogrammetry/recognition/ring_code.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

namespace videogrammetry {
namespace {

/// Largest distance of a change from its border, in sectors, on the ring's mean
/// and near its inner and outer border (where fewer pixels are averaged).
constexpr double kMaxShift = 0.22;
constexpr double kMaxShiftSingle = 0.35;
/// The sectors' heights between dark (0) and bright (1).
constexpr float kDarkBelow = 0.3f, kBrightAbove = 0.7f;

/// Places, in sectors, where the values cross `level`.
std::vector<double> Crossings(const std::vector<float>& values, float level, int per_sector) {
  std::vector<double> places;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const float a = values[i], b = values[(i + 1) % values.size()];
    if ((a >= level) == (b >= level)) continue;
    places.push_back((static_cast<double>(i) + (level - a) / (b - a)) / per_sector);
  }
  return places;
}

/// Phase of the sectors' borders, 0 <= phase < 1: the circular mean.
double Phase(const std::vector<double>& places) {
  std::complex<double> sum = 0;
  for (const double p : places) sum += std::polar(1.0, 2 * std::numbers::pi * p);
  const double phase = std::arg(sum) / (2 * std::numbers::pi);
  return phase < 0 ? phase + 1 : phase;
}

double LargestShift(const std::vector<double>& places, double phase) {
  double largest = 0;
  for (const double p : places) {
    const double d = p - phase;
    largest = std::max(largest, std::abs(d - std::round(d)));
  }
  return largest;
}

/// Mean of the middle part of sector k.
float SectorMean(const std::vector<float>& values, double phase, int k, int per_sector) {
  const int n = static_cast<int>(values.size());
  const int begin = static_cast<int>(std::lround((phase + k + 0.25) * per_sector));
  const int end = static_cast<int>(std::lround((phase + k + 0.75) * per_sector));
  float sum = 0;
  for (int i = begin; i <= end; ++i) sum += values[static_cast<std::size_t>(i % n)];
  return sum / static_cast<float>(end - begin + 1);
}

double FractionAbove(const std::vector<float>& values, float level) {
  const auto above = std::count_if(values.begin(), values.end(), [&](float v) { return v > level; });
  return static_cast<double>(above) / static_cast<double>(values.size());
}

/// The ring's sectors as bits, or why not.
struct Sectors {
  RingStatus status = RingStatus::kUnclear;
  std::uint32_t bits = 0;
  double quality = 0.0;
};

/// Bright sectors end at the ring's borders, dark ones are as dark as the gap.
bool SectorIsClean(const RingSamples& s, double phase, int k, bool bright, float half_way) {
  const auto mean = [&](const std::vector<float>& v) {
    return SectorMean(v, phase, k, s.per_sector);
  };
  if (bright) {
    return mean(s.inner) > half_way && mean(s.outer) > half_way && mean(s.gap) < half_way &&
           (s.outside.empty() || mean(s.outside) < half_way);
  }
  return mean(s.inner) < half_way && mean(s.outer) < half_way && mean(s.middle) > -0.3f;
}

Sectors ReadSectors(const RingSamples& s, int num_bits) {
  Sectors result;
  std::vector<float> ring(s.middle.size());
  for (std::size_t i = 0; i < ring.size(); ++i) {
    ring[i] = (s.inner[i] + s.middle[i] + s.outer[i]) / 3.0f;
  }
  const auto [low, high] = std::minmax_element(ring.begin(), ring.end());
  const float dark = *low, bright = *high, height = bright - dark;
  if (height < 0.5f || dark > 0.4f) return result;
  const float half_way = 0.5f * (dark + bright);
  const auto places = Crossings(ring, half_way, s.per_sector);
  if (static_cast<int>(places.size()) > num_bits) return result;
  const double phase = Phase(places);
  const double shift = LargestShift(places, phase);
  float least = 0.5f;
  for (int k = 0; k < num_bits; ++k) {
    const float v = (SectorMean(ring, phase, k, s.per_sector) - dark) / height;
    const bool is_bright = v > 0.5f;
    result.bits = (result.bits << 1) | (is_bright ? 1u : 0u);
    least = std::min(least, std::abs(v - 0.5f));
    if ((v > kDarkBelow && v < kBrightAbove) ||
        !SectorIsClean(s, phase, k, is_bright, half_way)) {
      return result;
    }
  }
  result.status = RingStatus::kEdgesOff;
  if (shift > kMaxShift) return result;
  for (const auto* circle : {&s.inner, &s.outer}) {
    const auto single = Crossings(*circle, half_way, s.per_sector);
    if (single.size() != places.size() || LargestShift(single, phase) > kMaxShiftSingle) {
      return result;
    }
  }
  result.status = RingStatus::kCoded;
  result.quality = least - shift;
  return result;
}

}  // namespace

RingReading ReadRing(const RingSamples& samples, const CodeFamily& family,
                     ReadingDirection direction) {
  RingReading reading;
  if (FractionAbove(samples.gap, 0.5f) > 0.03 || FractionAbove(samples.middle, 0.5f) == 0.0) {
    return reading;
  }
  const Sectors sectors = ReadSectors(samples, family.num_bits);
  reading.status = sectors.status;
  if (sectors.status != RingStatus::kCoded) return reading;
  reading.quality = sectors.quality;
  const int n = family.num_bits;
  const std::uint32_t clockwise = CanonicalCode(sectors.bits, n);
  const std::uint32_t counter = CanonicalCode(ReversedCode(sectors.bits, n), n);
  const bool as_seen = direction == ReadingDirection::kClockwise;
  reading.id = family.IdOf(as_seen ? clockwise : counter);
  if (!reading.id) {
    reading.status = family.IdOf(as_seen ? counter : clockwise) ? RingStatus::kMirrored
                                                                : RingStatus::kNotInTable;
  }
  return reading;
}

template <typename T>
RingReading ReadRing(const SignedImage<T>& image, const TargetEdge& dot, const CodeFamily& family,
                     ReadingDirection direction) {
  if (family.num_bits == 0) return {};
  const auto samples =
      SampleRing(image, dot, family.ring_inner, family.ring_outer, family.num_bits);
  if (!samples) return {RingStatus::kRingCut, std::nullopt, 0.0};
  return ReadRing(*samples, family, direction);
}

template RingReading ReadRing(const SignedImage<std::uint8_t>&, const TargetEdge&,
                              const CodeFamily&, ReadingDirection);
template RingReading ReadRing(const SignedImage<std::uint16_t>&, const TargetEdge&,
                              const CodeFamily&, ReadingDirection);

}  // namespace videogrammetry
