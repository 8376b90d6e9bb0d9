#include "videogrammetry/recognition/ring_code.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

namespace videogrammetry {
namespace {

/// Largest distance of a change from its border, in sectors: on the ring's mean,
/// and near its inner and outer border, where fewer pixels are averaged.
constexpr double kMaxShift = 0.22;
constexpr double kMaxShiftSingle = 0.35;
/// Least difference between the darkest bright and the brightest dark sector,
/// in units of the dot's contrast; a flash may halve the light along a ring.
constexpr float kMinStep = 0.3f;
/// The brightest dark sector as a part of the darkest bright one.
constexpr float kMaxDark = 0.4f;
/// Largest departure of a bright sector's height from those of the others, with
/// light that changes evenly across the target, as a part of their mean.
constexpr double kMaxUneven = 0.25;
/// A first, rough level between bright and dark, from the ring's darkest (0)
/// to its brightest value (1).
constexpr float kRoughLevel = 0.3f;

/// Places, in sectors, where the values cross `level`; NaN are passed over.
std::vector<double> Crossings(const std::vector<float>& values, float level, int per_sector) {
  std::vector<double> places;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const float a = values[i], b = values[(i + 1) % values.size()];
    if (std::isnan(a) || std::isnan(b) || (a >= level) == (b >= level)) continue;
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

/// Mean of the middle half of sector k; NaN if a sample is.
float SectorMean(const std::vector<float>& values, double phase, int k, int per_sector) {
  const int n = static_cast<int>(values.size());
  const int begin = static_cast<int>(std::lround((phase + k + 0.25) * per_sector));
  const int end = static_cast<int>(std::lround((phase + k + 0.75) * per_sector));
  float sum = 0;
  for (int i = begin; i <= end; ++i) sum += values[static_cast<std::size_t>(i % n)];
  return sum / static_cast<float>(end - begin + 1);
}

double FractionAbove(const std::vector<float>& values, float level) {
  const auto above =
      std::count_if(values.begin(), values.end(), [&](float v) { return v > level; });
  return static_cast<double>(above) / static_cast<double>(values.size());
}

/// The ring's sectors: their heights, and bright or dark.
struct Sectors {
  RingStatus status = RingStatus::kUnclear;
  std::vector<float> height;
  std::vector<char> bright;
  std::uint32_t bits = 0;
  double phase = 0.0;
  double quality = 0.0;

  int changes() const {
    int count = 0;
    for (std::size_t k = 0; k < bright.size(); ++k) {
      count += bright[k] != bright[(k + 1) % bright.size()];
    }
    return count;
  }
};

/// Divides the sectors into dark and bright ones at the largest step of their sorted heights.
bool Divide(Sectors* s, float* step) {
  std::vector<float> sorted = s->height;
  std::sort(sorted.begin(), sorted.end());
  std::size_t cut = 1;
  for (std::size_t i = 1; i < sorted.size(); ++i) {
    if (sorted[i] - sorted[i - 1] > sorted[cut] - sorted[cut - 1]) cut = i;
  }
  *step = sorted[cut] - sorted[cut - 1];
  // Not one grey is the sum of two: a third group may not hide in either.
  if (!(*step > kMinStep) || sorted[cut - 1] > kMaxDark * sorted[cut] || sorted[0] < -0.4f) {
    return false;
  }
  s->bright.clear();
  s->bits = 0;
  for (const float h : s->height) {
    s->bright.push_back(h >= sorted[cut]);
    s->bits = (s->bits << 1) | (h >= sorted[cut] ? 1u : 0u);
  }
  return true;
}

/// Whether the bright sectors' heights follow one even change of light: a grey
/// one in between is neither bright nor dark.
bool IsEvenlyLit(const Sectors& s) {
  // Mean and first harmonic; a little stiffness where few sectors are bright.
  Eigen::Matrix3d normal = Eigen::Vector3d(0.0, 0.2, 0.2).asDiagonal();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  const auto row_of = [&](std::size_t k) {
    const double t =
        2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(s.height.size());
    return Eigen::Vector3d(1.0, std::cos(t), std::sin(t));
  };
  for (std::size_t k = 0; k < s.height.size(); ++k) {
    if (!s.bright[k]) continue;
    normal += row_of(k) * row_of(k).transpose();
    right += s.height[k] * row_of(k);
  }
  const Eigen::Vector3d light = normal.ldlt().solve(right);
  for (std::size_t k = 0; k < s.height.size(); ++k) {
    if (s.bright[k] && std::abs(s.height[k] - row_of(k).dot(light)) > kMaxUneven * light[0]) {
      return false;
    }
  }
  return true;
}

/// Bright sectors end at the ring's borders, dark ones are dark up to them.
bool IsClean(const RingSamples& samples, const Sectors& s) {
  for (std::size_t k = 0; k < s.height.size(); ++k) {
    const auto mean = [&](const std::vector<float>& v) {
      return SectorMean(v, s.phase, static_cast<int>(k), samples.per_sector);
    };
    const float half_way = 0.5f * s.height[k];
    if (s.bright[k]) {
      // Written so that NaN, outside the picture, fails no test.
      if (mean(samples.inner) < half_way || mean(samples.outer) < half_way ||
          mean(samples.gap) > half_way || mean(samples.outside) > half_way) {
        return false;
      }
    } else if (mean(samples.inner) > kMinStep || mean(samples.outer) > kMinStep) {
      return false;
    }
  }
  return true;
}

/// Largest distance of the changes between unlike sectors from their borders,
/// each at the level half-way between its two sectors.
double LargestShift(const std::vector<float>& values, const Sectors& s, int per_sector) {
  double largest = 0;
  const std::size_t n = s.height.size();
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t next = (k + 1) % n;
    if (s.bright[k] == s.bright[next]) continue;
    const double border = s.phase + static_cast<double>(k) + 1.0;
    double nearest = 0.5;
    bool hidden = false;
    for (int i = -per_sector / 2; i < per_sector / 2; ++i) {
      const int at = static_cast<int>(std::lround(border * per_sector)) + i;
      const auto size = static_cast<int>(values.size());
      const float a = values[static_cast<std::size_t>((at + size) % size)];
      const float b = values[static_cast<std::size_t>((at + 1 + size) % size)];
      hidden |= std::isnan(a) || std::isnan(b);
      const float level = 0.5f * (s.height[k] + s.height[next]);
      if ((a >= level) == (b >= level)) continue;
      const double place = (at + (level - a) / (b - a)) / per_sector;
      nearest = std::min(nearest, std::abs(place - border));
    }
    if (!hidden) largest = std::max(largest, nearest);
  }
  return largest;
}

/// Mean of the circles on the ring at each direction, of those in the picture.
std::vector<float> MeanRing(const RingSamples& s) {
  std::vector<float> ring(s.inner.size());
  for (std::size_t i = 0; i < ring.size(); ++i) {
    float sum = 0, count = 0;
    for (const float v : {s.inner[i], s.middle[i], s.outer[i]}) {
      if (std::isnan(v)) continue;
      sum += v;
      count += 1;
    }
    ring[i] = sum / count;
  }
  return ring;
}

Sectors ReadSectors(const RingSamples& samples, const std::vector<float>& ring, int num_bits) {
  Sectors s;
  const auto [low, high] = std::minmax_element(ring.begin(), ring.end());
  const auto rough = Crossings(ring, *low + kRoughLevel * (*high - *low), samples.per_sector);
  if (*high - *low < kMinStep || static_cast<int>(rough.size()) > num_bits) return s;
  s.phase = Phase(rough);
  for (int k = 0; k < num_bits; ++k) {
    s.height.push_back(SectorMean(ring, s.phase, k, samples.per_sector));
  }
  float step = 0;
  if (!Divide(&s, &step) || !IsEvenlyLit(s) || !IsClean(samples, s)) return s;
  s.status = RingStatus::kEdgesOff;
  const double shift = LargestShift(ring, s, samples.per_sector);
  if (s.changes() != static_cast<int>(rough.size()) || shift > kMaxShift) return s;
  for (const auto* circle : {&samples.inner, &samples.outer}) {
    if (LargestShift(*circle, s, samples.per_sector) > kMaxShiftSingle) return s;
  }
  s.status = RingStatus::kCoded;
  s.quality = 0.5 * std::min(1.0f, step) - shift;
  return s;
}

}  // namespace

RingReading ReadRing(const RingSamples& samples, const CodeFamily& family,
                     ReadingDirection direction) {
  RingReading reading;
  const std::vector<float> ring = MeanRing(samples);
  if (FractionAbove(samples.gap, 0.5f) > 0.03 || FractionAbove(ring, kMinStep) < 0.02) {
    return reading;
  }
  const Sectors sectors = ReadSectors(samples, ring, family.num_bits);
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
