#include "videogrammetry/recognition/ring_code.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "videogrammetry/recognition/ring_confidence.h"
#include "videogrammetry/recognition/ring_sectors.h"

namespace videogrammetry {
namespace {

/// Least probability with which an ID is given.
constexpr double kLeastConfidence = 0.999;
/// Standard deviations of a change's place that noise does not explain, in pixels and in
/// sectors.
constexpr float kPlaceSigmaPx = 0.05f;
constexpr float kPlaceSigmaSectors = 0.012f;
/// Width of a ring whose changes are known half as well (in variance) as the dot's edge.
constexpr float kNarrowPx = 5.0f;
/// The same of a change near the ring's inner or outer border, where a third of the
/// pixels are averaged; by how many of it, and by how much of the square of the blur
/// over the sector's length (sectors are shorter there, and single ones seem
/// wider), it may be off its border.
constexpr float kSinglePlaceSigmaPx = 0.1f;
constexpr float kSinglePlaceSigmaSectors = 0.02f;
constexpr float kSingleTimes = 4.5f;
constexpr float kSingleBlur = 0.8f;
constexpr float kMaxShiftSingle = 0.3f;
/// A ring is sampled anew if it shows its dot to be this much larger than measured.
constexpr double kLeastScale = 1.015;
constexpr float kNoLimit = std::numeric_limits<float>::infinity();

/// Changes, and what to measure them by near the ring's borders.
struct MeasuredChanges : RingChanges {
  std::array<float, kMaxCodeBits> level = {}, single_limit = {};
};

/// Distance of the change before sector `next` from that border, in sectors, of the
/// crossing of `level` that is nearest; half a sector where there is none.
float Shift(const RingCircle& values, int count, int next, float level, bool rises, bool* hidden) {
  const int border = next * kRingPerSector;  // between the samples border - 1 and border
  float nearest = 0.5f;
  for (int i = -kRingPerSector / 2; i < kRingPerSector / 2; ++i) {
    int from = border + i - 1, to = border + i;
    from += from < 0 ? count : 0;
    to += to < 0 ? count : 0;
    const float a = values[static_cast<std::size_t>(from)],
                b = values[static_cast<std::size_t>(to)];
    if (std::isnan(a) || std::isnan(b)) {
      *hidden = true;
      return 0.0f;
    }
    if ((a >= level) == (b >= level)) continue;
    if ((b > a) != rises) return 0.5f;  // up and down again: no one change
    const float place = (static_cast<float>(i) - 0.5f + (level - a) / (b - a)) / kRingPerSector;
    if (std::abs(place) < std::abs(nearest)) nearest = place;
  }
  return nearest;
}

float Hypot3(float a, float b, float c) { return std::sqrt(a * a + b * b + c * c); }

/// The changes on the ring's mean, from their borders.
bool MeasureChanges(const RingSamples& samples, const RingCircle& ring, const RingSectors& s,
                    MeasuredChanges* changes) {
  const int count = kRingPerSector * s.n;
  for (int k = 0; k < s.n; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const std::size_t before = k == 0 ? static_cast<std::size_t>(s.n - 1) : at - 1;
    if (s.bright[at] == s.bright[before]) continue;
    const float level = 0.5f * (s.plateau[at] + s.plateau[before]);
    bool hidden = false;
    const float shift = Shift(ring, count, k, level, s.bright[at], &hidden);
    if (hidden) continue;
    if (std::abs(shift) > 0.4f) return false;
    const auto i = static_cast<std::size_t>(changes->count++);
    const float length = 0.5f * (samples.length_px[at] + samples.length_px[before]);
    const float contrast = std::abs(s.plateau[at] - s.plateau[before]);
    const float noise = samples.edge_sigma_px / (contrast * length);
    changes->border[i] = k;
    changes->shift[i] = shift;
    // The dot's edge is a mean over profiles; of a narrow ring's fewer pixels are averaged.
    const float width_px = samples.length_px[at] * samples.blur_along[at] / samples.blur_across[at];
    changes->sigma[i] = Hypot3(noise * std::sqrt(1.0f + kNarrowPx / width_px),
                               kPlaceSigmaPx / length, kPlaceSigmaSectors);
    changes->level[i] = level;
    changes->single_limit[i] = std::min(
        kMaxShiftSingle, kSingleBlur * samples.blur_along[at] * samples.blur_along[at] +
                             kSingleTimes * Hypot3(1.7f * noise, kSinglePlaceSigmaPx / length,
                                                   kSinglePlaceSigmaSectors));
  }
  return true;
}

/// Whether the changes near the ring's borders stand where those on its mean do.
bool AgreeAcrossTheRing(const RingSamples& samples, const RingSectors& s,
                        const MeasuredChanges& changes, float phase) {
  for (int i = 0; i < changes.count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const int k = changes.border[at];
    for (const RingCircle* circle : {&samples.inner, &samples.outer}) {
      bool hidden = false;
      const float shift = Shift(*circle, kRingPerSector * s.n, k, changes.level[at],
                                s.bright[static_cast<std::size_t>(k)], &hidden);
      if (!hidden && std::abs(shift - phase) > changes.single_limit[at]) return false;
    }
  }
  return true;
}

/// Places (0 ... 1 of a sector) of the rough changes along the first look, as the
/// direction of their circular mean.
double RoughPhase(const BesideCircle& ring, int count, float level) {
  double x = 0, y = 0;
  for (int i = 0; i < count; ++i) {
    const float a = ring[static_cast<std::size_t>(i)];
    const float b = ring[static_cast<std::size_t>(i + 1 == count ? 0 : i + 1)];
    if ((a >= level) == (b >= level) || std::isnan(a) || std::isnan(b)) continue;
    const double part = (level - a) / (b - a);
    // The quarter of a sector turns by a right angle; within it a straight line is
    // close enough.
    const double c = 1.0 - part, d = part;
    switch (i % kBesidePerSector) {
      case 0:
        x += c, y += d;
        break;
      case 1:
        x -= d, y += c;
        break;
      case 2:
        x -= c, y -= d;
        break;
      default:
        x += d, y -= c;
        break;
    }
  }
  const double phase = std::atan2(y, x) / (2 * std::numbers::pi);
  return phase < 0 ? phase + 1 : phase;
}

/// How much larger than its measured dot a blurred ring shows the dot to be.
///
/// A blurred dot's edge is found too far inside, by about 0.8 (blur / radius)^2 of the
/// radius. Then the circle near the ring's outer border is brighter than the one near
/// its inner border, by 2 phi(0.2 / b) / b of the light for each ring's width between
/// (b: blur over that width). Other radii of the ring, another family's, are not
/// to be taken for that: the factor is at most `largest`.
double RingScale(const RingSamples& samples, const CodeFamily& family, double largest) {
  const auto n = static_cast<std::size_t>(samples.num_bits);
  PerSector inner, middle = {}, outer;
  MeanSectors(samples.inner, samples.num_bits, &inner);
  MeanSectors(samples.middle, samples.num_bits, &middle);
  MeanSectors(samples.outer, samples.num_bits, &outer);
  const float level = 0.5f * *std::max_element(middle.begin(), middle.begin() + samples.num_bits);
  double difference = 0, slope = 0;
  for (std::size_t k = 0; k < n; ++k) {
    if (!(middle[k] > level) || std::isnan(outer[k])) continue;
    const double b = samples.blur_across[k];
    difference += outer[k] - inner[k];
    slope += 0.8 * middle[k] / b * std::exp(-0.02 / (b * b));
  }
  if (!(slope > 0)) return 1.0;
  const double per_width =
      2 * (family.ring_outer - family.ring_inner) / (family.ring_inner + family.ring_outer);
  return std::clamp(1.0 + difference / slope * per_width, 1.0, largest);
}

void Look(const CodeFamily& family, ReadingDirection direction, std::uint32_t bits,
          RingReading* reading) {
  const int n = family.num_bits;
  const std::uint32_t as_seen = CanonicalCode(bits, n);
  const std::uint32_t turned = CanonicalCode(ReversedCode(bits, n), n);
  const bool clockwise = direction == ReadingDirection::kClockwise;
  reading->id = family.IdOf(clockwise ? as_seen : turned);
  reading->status = reading->id                                 ? RingStatus::kCoded
                    : family.IdOf(clockwise ? turned : as_seen) ? RingStatus::kMirrored
                                                                : RingStatus::kNotInTable;
}

}  // namespace

RingReading ReadRing(const RingSamples& samples, const CodeFamily& family,
                     ReadingDirection direction) {
  RingReading reading;
  reading.status = RingStatus::kUnclear;
  RingCircle ring;
  MeanRing(samples, &ring);
  RingSectors s;
  if (!MeasureSectors(samples, ring, &s)) return reading;
  const double wrong = WrongSectorProbability(samples, s);
  reading.status = RingStatus::kEdgesOff;
  MeasuredChanges changes;
  if (!IsUniform(samples, s) || !MeasureChanges(samples, ring, s, &changes)) return reading;
  const double mean = RemovePhase(&changes);
  if (!AgreeAcrossTheRing(samples, s, changes, static_cast<float>(mean))) return reading;
  reading.bits = s.bits;
  reading.phase_sectors = mean;
  const double foreign = ForeignProbability(changes, s.n);
  if (foreign > 1.0 - kLeastConfidence) return reading;
  reading.status = RingStatus::kUnclear;
  if (wrong + foreign > 1.0 - kLeastConfidence) return reading;
  Look(family, direction, s.bits, &reading);
  float largest = 0;
  for (int i = 0; i < changes.count; ++i) {
    largest = std::max(largest, std::abs(changes.shift[static_cast<std::size_t>(i)]));
  }
  reading.quality = 0.5 * std::min(1.0f, s.step) - largest;
  if (reading.id) reading.confidence = (1.0 - wrong) * (1.0 - foreign);
  return reading;
}

RingReading ReadRing(const GreySampler& picture, const TargetEdge& dot, const CodeFamily& family,
                     ReadingDirection direction) {
  RingReading reading;
  if (family.num_bits == 0) return reading;
  const int count = kBesidePerSector * family.num_bits;
  RingSampler sampler(picture, dot, family);
  BesideCircle look, gap;
  RingSamples samples;
  if (!sampler.Middle(&look) && !sampler.Sample(0.0, &samples)) {
    reading.status = RingStatus::kRingCut;
    return reading;
  }
  // Four of each, so that they are found side by side; NaN is passed over.
  std::array<int, 4> brights = {};
  std::array<float, 4> lows, highs;
  lows.fill(kNoLimit), highs.fill(-kNoLimit);
  for (int i = 0; i < count; i += 4) {
    for (std::size_t j = 0; j < 4; ++j) {
      const float v = look[static_cast<std::size_t>(i) + j];
      brights[j] += v > kMinStep ? 1 : 0;
      lows[j] = v < lows[j] ? v : lows[j];
      highs[j] = v > highs[j] ? v : highs[j];
    }
  }
  const int bright = brights[0] + brights[1] + brights[2] + brights[3];
  const float low = std::min(std::min(lows[0], lows[1]), std::min(lows[2], lows[3]));
  const float high = std::max(std::max(highs[0], highs[1]), std::max(highs[2], highs[3]));
  if (bright < 2) return reading;
  sampler.Gap(&gap);
  int closed = 0;
  for (int i = 0; i < count; ++i) closed += gap[static_cast<std::size_t>(i)] > 0.5f ? 1 : 0;
  if (30 * closed > count) return reading;
  const double phase = RoughPhase(look, count, low + 0.4f * (high - low));
  if (!sampler.Sample(phase, &samples)) {
    reading.status = RingStatus::kRingCut;
    return reading;
  }
  const auto read = [&] {
    RingReading found = ReadRing(samples, family, direction);
    found.phase_sectors += phase;
    return found;
  };
  reading = read();
  if (reading.status != RingStatus::kUnclear && reading.status != RingStatus::kEdgesOff) {
    return reading;
  }
  const double scale = RingScale(samples, family, sampler.LargestScale());
  if (scale < kLeastScale) return reading;
  sampler.Scale(scale);
  if (!sampler.Sample(phase, &samples)) return reading;
  const RingReading again = read();
  return again.id ? again : reading;
}

}  // namespace videogrammetry
