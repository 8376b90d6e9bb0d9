// A ring whose code is known already: is it still the same, and where is it now?

#include <array>
#include <cmath>
#include <cstddef>

#include "videogrammetry/recognition/ring_code.h"
#include "videogrammetry/recognition/ring_sectors.h"

namespace videogrammetry {
namespace {

/// Least height of a bright sector and largest of a dark one, in units of the bright ones' mean.
constexpr float kLeastBright = 0.7f, kMostDark = 0.35f;
/// How far changes may be from where they were, and from each other, in sectors.
constexpr float kMostMoved = 0.2f, kMostApart = 0.15f;

static_assert(kBesidePerSector == 4, "places of a sector: 1/8, 3/8, 5/8, 7/8");

struct KnownRing {
  const BesideCircle& samples;
  const RingReading& before;
  int n;

  bool IsBright(int k) const { return ((before.bits >> (n - 1 - k)) & 1u) != 0; }
  float At(int k, int i) const {
    return samples[static_cast<std::size_t>(kBesidePerSector * k + i)];
  }
  /// Mean of the sector's middle half.
  float Height(int k) const { return 0.5f * (At(k, 1) + At(k, 2)); }
};

/// Mean height of the bright sectors, or 0 if a sector is not as it was.
float BrightLevel(const KnownRing& ring) {
  float sum = 0.0f, lowest = 1e30f, highest_dark = -1e30f, lowest_dark = 1e30f;
  int count = 0;
  for (int k = 0; k < ring.n; ++k) {
    const float h = ring.Height(k);
    if (ring.IsBright(k)) {
      sum += h;
      ++count;
      lowest = h < lowest ? h : lowest;
    } else {
      highest_dark = h > highest_dark ? h : highest_dark;
      lowest_dark = h < lowest_dark ? h : lowest_dark;
    }
  }
  if (count == 0 || count == ring.n) return 0.0f;
  const float mean = sum / static_cast<float>(count);
  const bool same = mean > kMinStep && lowest >= kLeastBright * mean &&
                    highest_dark <= kMostDark * mean && lowest_dark >= -kMostDark * mean;
  return same ? mean : 0.0f;
}

}  // namespace

std::optional<RingReading> FollowRing(const GreySampler& picture, const TargetEdge& dot,
                                      const CodeFamily& family, const RingReading& before) {
  if (before.status != RingStatus::kCoded || family.num_bits == 0) return std::nullopt;
  BesideCircle samples;
  if (!RingSampler(picture, dot, family).MiddleFrom(before.phase_sectors, &samples)) {
    return std::nullopt;
  }
  const KnownRing ring = {samples, before, family.num_bits};
  const float level = BrightLevel(ring);
  if (!(level > 0.0f)) return std::nullopt;
  // What the four samples around a border hold of the step's height says where it is, as long
  // as it is between them.
  float sum = 0.0f, least = 1.0f, most = -1.0f;
  int changes = 0;
  for (int k = 0; k < ring.n; ++k) {
    const int last = k == 0 ? ring.n - 1 : k - 1;
    if (ring.IsBright(k) == ring.IsBright(last)) continue;
    const float low = ring.Height(ring.IsBright(k) ? last : k);
    const float high = ring.Height(ring.IsBright(k) ? k : last);
    const float around = ring.At(last, 2) + ring.At(last, 3) + ring.At(k, 0) + ring.At(k, 1);
    const float part = (0.25f * around - low) / (high - low);
    const float shift = ring.IsBright(k) ? 0.5f - part : part - 0.5f;
    sum += shift;
    least = shift < least ? shift : least;
    most = shift > most ? shift : most;
    ++changes;
  }
  const float mean = sum / static_cast<float>(changes);
  if (!(std::abs(mean) <= kMostMoved) || !(most - least <= 2.0f * kMostApart)) return std::nullopt;
  RingReading reading = before;
  reading.phase_sectors += static_cast<double>(mean);
  return reading;
}

}  // namespace videogrammetry
