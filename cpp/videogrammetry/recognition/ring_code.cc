#include "videogrammetry/recognition/ring_code.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "videogrammetry/recognition/ring_confidence.h"

namespace videogrammetry {
namespace {

/// Least probability with which an ID is given.
constexpr double kLeastConfidence = 0.999;
/// Standard deviations of what noise does not explain: of a change's place, in
/// pixels and in sectors, and of a sector's height.
constexpr float kPlaceSigmaPx = 0.05f;
constexpr float kPlaceSigmaSectors = 0.012f;
constexpr float kHeightSigma = 0.07f;
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
/// How far single samples may be from what their sector is, as a part of the
/// light, and in standard deviations of the noise.
constexpr float kUniform = 0.25f;
constexpr float kNoiseTimes = 4.5f;
/// Least difference between the darkest bright and the brightest dark sector,
/// in units of the dot's contrast; a flash may halve the light along a ring.
constexpr float kMinStep = 0.3f;
/// The brightest dark sector as a part of the darkest bright one.
constexpr float kMaxDark = 0.4f;
constexpr float kDarkest = -0.4f;
/// Largest departure of a bright sector's height from those of the others, with
/// light that changes evenly across the target, as a part of their mean.
constexpr float kMaxUneven = 0.25f;

/// What of a sector's mean comes from each neighbour, and what is left of it by the
/// ring's narrowness, for a blur given as a part of the sector or of the ring.
class BlurTable {
 public:
  static const BlurTable& Get() {
    static const BlurTable table;
    return table;
  }
  float Leak(float blur) const { return At(leak_, blur); }
  float Left(float blur) const { return At(left_, blur); }
  float Beyond(float blur) const { return At(beyond_, blur); }

 private:
  static constexpr int kSteps = 64;
  using Table = std::array<float, kSteps + 1>;

  BlurTable() {
    const auto phi = [](double z) { return 0.5 * std::erfc(-z * std::numbers::sqrt2 / 2); };
    for (int i = 0; i <= kSteps; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const double blur = std::max(1e-3, static_cast<double>(i) / kSteps);
      double leak = 0, left = 0;
      for (const double p : {0.3125, 0.4375, 0.5625, 0.6875}) leak += 0.25 * phi(-p / blur);
      for (const double p : {0.2, 0.5, 0.8}) left += (phi((1 - p) / blur) - phi(-p / blur)) / 3;
      leak_[at] = static_cast<float>(std::min(leak, 0.22));
      left_[at] = static_cast<float>(left);
      beyond_[at] = static_cast<float>((phi(1.2 / blur) - phi(0.2 / blur)));
    }
  }
  static float At(const Table& table, float blur) {
    const float place = std::min(blur, 0.999f) * kSteps;
    const int i = static_cast<int>(place);
    const auto at = static_cast<std::size_t>(i);
    return table[at] + (place - static_cast<float>(i)) * (table[at + 1] - table[at]);
  }

  Table leak_, left_, beyond_;
};

/// Changes, and what to measure them by near the ring's borders.
struct MeasuredChanges : RingChanges {
  std::array<float, kMaxCodeBits> level = {}, single_limit = {};
};

using PerSector = std::array<float, kMaxCodeBits>;

/// The ring's sectors: their heights, and bright or dark.
struct Sectors {
  int n = 0;
  PerSector plateau = {};  ///< freed from what comes from the neighbours
  PerSector height = {};   ///< and from the loss across the ring: the print's
  PerSector light = {};    ///< of a bright sector at its place
  PerSector left = {};
  std::array<bool, kMaxCodeBits> bright = {};
  std::uint32_t bits = 0;
  float step = 0;
};

/// Means of each sector's middle half; samples outside the picture (NaN) are left out
/// where `skip_nan`.
template <int kPerSectorCount>
void SectorMeans(const float* values, int n, PerSector* means) {
  constexpr int kQuarter = kPerSectorCount / 4;
  for (int k = 0; k < n; ++k) {
    float sum = 0;
    for (int i = kQuarter; i < 3 * kQuarter; ++i) sum += values[k * kPerSectorCount + i];
    (*means)[static_cast<std::size_t>(k)] = sum / (2 * kQuarter);
  }
}

/// Mean of the circles on the ring at each direction, of those in the picture.
void MeanRing(const RingSamples& s, RingCircle* ring) {
  const int count = kRingPerSector * s.num_bits;
  float check = 0;
  for (int i = 0; i < count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const float sum = s.inner[at] + s.middle[at] + s.outer[at];
    check += sum;
    (*ring)[at] = sum * (1.0f / 3.0f);
  }
  if (!std::isnan(check)) return;
  for (int i = 0; i < count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    float sum = 0, number = 0;
    for (const float v : {s.inner[at], s.middle[at], s.outer[at]}) {
      if (std::isnan(v)) continue;
      sum += v;
      number += 1;
    }
    (*ring)[at] = sum / number;
  }
}

/// Heights of the print from the sectors' means h: h_k = (1 - 2 l_k) b_k + l_k (b_k-1 +
/// b_k+1) solved by Jacobi's iteration (l <= 0.22: it converges), then over what
/// the ring's narrowness leaves.
void Unblur(const RingSamples& samples, const PerSector& means, Sectors* s) {
  const auto& table = BlurTable::Get();
  const auto n = static_cast<std::size_t>(s->n);
  PerSector leak, scale, next;
  for (std::size_t k = 0; k < n; ++k) {
    leak[k] = table.Leak(samples.blur_along[k]);
    scale[k] = 1.0f / (1.0f - 2.0f * leak[k]);
    s->left[k] = std::max(0.4f, table.Left(samples.blur_across[k]));
  }
  s->plateau = means;
  for (int round = 0; round < 3; ++round) {
    for (std::size_t k = 0; k < n; ++k) {
      const float before = s->plateau[k == 0 ? n - 1 : k - 1];
      const float after = s->plateau[k + 1 == n ? 0 : k + 1];
      next[k] = (means[k] - leak[k] * (before + after)) * scale[k];
    }
    s->plateau = next;
  }
  for (std::size_t k = 0; k < n; ++k) s->height[k] = s->plateau[k] / s->left[k];
}

/// Whether a division into heights up to `dark` and from `bright` on is one.
bool IsDivided(float darkest, float dark, float bright) {
  // Not one grey is the sum of two: a third group may not hide in either.
  return bright - dark > kMinStep && dark <= kMaxDark * bright && darkest >= kDarkest;
}

/// Divides the sectors into dark and bright ones: at 0.4 of the brightest, or else at
/// the largest step of their sorted heights.
bool Divide(Sectors* s) {
  const auto n = static_cast<std::size_t>(s->n);
  float lowest = s->height[0], highest = s->height[0];
  for (std::size_t k = 1; k < n; ++k) {
    lowest = std::min(lowest, s->height[k]);
    highest = std::max(highest, s->height[k]);
  }
  float bright = highest, dark = lowest;
  for (std::size_t k = 0; k < n; ++k) {
    const float h = s->height[k];
    const bool above = h >= kMaxDark * highest;
    bright = above ? std::min(bright, h) : bright;
    dark = above ? dark : std::max(dark, h);
  }
  if (!IsDivided(lowest, dark, bright)) {
    PerSector sorted = s->height;
    std::sort(sorted.begin(), sorted.begin() + s->n);
    std::size_t cut = 1;
    for (std::size_t i = 1; i < n; ++i) {
      if (sorted[i] - sorted[i - 1] > sorted[cut] - sorted[cut - 1]) cut = i;
    }
    dark = sorted[cut - 1], bright = sorted[cut];
    if (!IsDivided(lowest, dark, bright)) return false;
  }
  s->step = bright - dark;
  s->bits = 0;
  for (std::size_t k = 0; k < n; ++k) {
    s->bright[k] = s->height[k] >= bright;
    s->bits = (s->bits << 1) | (s->bright[k] ? 1u : 0u);
  }
  return true;
}

/// Whether the bright sectors' heights follow one even change of light: a grey
/// one in between is neither bright nor dark.
bool IsEvenlyLit(const PerSector& cosine, const PerSector& sine, Sectors* s) {
  // Mean and first harmonic; a little stiffness where few sectors are bright.
  Eigen::Matrix3f normal = Eigen::Vector3f(0.0f, 0.2f, 0.2f).asDiagonal();
  Eigen::Vector3f right = Eigen::Vector3f::Zero();
  const auto n = static_cast<std::size_t>(s->n);
  for (std::size_t k = 0; k < n; ++k) {
    if (!s->bright[k]) continue;
    const Eigen::Vector3f row(1.0f, cosine[k], sine[k]);
    normal += row * row.transpose();
    right += s->height[k] * row;
  }
  const Eigen::Vector3f light = normal.llt().solve(right);
  bool even = true;
  for (std::size_t k = 0; k < n; ++k) {
    s->light[k] = light[0] + light[1] * cosine[k] + light[2] * sine[k];
    even &= !s->bright[k] || std::abs(s->height[k] - s->light[k]) <= kMaxUneven * light[0];
    even &= s->light[k] > kMinStep;
  }
  return even;
}

/// Bright sectors end at the ring's borders, dark ones are dark up to them.
bool IsClean(const RingSamples& samples, const Sectors& s) {
  const auto& table = BlurTable::Get();
  PerSector inner, outer, outside;
  SectorMeans<kRingPerSector>(samples.inner.data(), s.n, &inner);
  SectorMeans<kRingPerSector>(samples.outer.data(), s.n, &outer);
  SectorMeans<kBesidePerSector>(samples.outside.data(), s.n, &outside);
  for (std::size_t k = 0; k < static_cast<std::size_t>(s.n); ++k) {
    const float half_way = 0.5f * s.plateau[k];
    // Written so that NaN, outside the picture, fails no test.
    if (s.bright[k]) {
      // Half-way between a ring that ends, of which the blur lets something be
      // seen beyond, and one that goes on.
      const float level =
          0.5f * s.plateau[k] * (1.0f + table.Beyond(samples.blur_across[k]) / s.left[k]);
      if (inner[k] < half_way || outer[k] < half_way || outside[k] > level) return false;
    } else if (inner[k] > kMinStep || outer[k] > kMinStep) {
      return false;
    }
  }
  return true;
}

/// Whether every sample is as its sector is, on each circle of the ring, but within a
/// quarter of a sector of a change: what is left of a hidden sector shows, and so
/// does a change that stands between two like sectors.
bool IsUniform(const RingSamples& samples, const Sectors& s) {
  constexpr std::size_t kQuarter = kRingPerSector / 4;
  const auto& table = BlurTable::Get();
  const auto n = static_cast<std::size_t>(s.n);
  for (std::size_t k = 0; k < n; ++k) {
    const bool bright = s.bright[k];
    const bool left = s.bright[k == 0 ? n - 1 : k - 1] != bright;
    const bool right = s.bright[k + 1 == n ? 0 : k + 1] != bright;
    const float light = s.light[k] * s.left[k];
    // The blur brings twice the mean's share to the samples nearest to a change.
    const float spread = kUniform * light + kNoiseTimes * samples.grey_sigma +
                         2.0f * table.Leak(samples.blur_along[k]) * light *
                             static_cast<float>(static_cast<int>(left) + static_cast<int>(right));
    for (const RingCircle* circle : {&samples.inner, &samples.middle, &samples.outer}) {
      const float* v = circle->data() + kRingPerSector * k;
      // Glare on a bright sector is no fault, what is too dark there may hide something.
      const float low =
          bright ? std::min(0.25f * ((v[2] + v[3]) + (v[4] + v[5])), light) - spread : -spread;
      const float high = bright ? kNoLimit : spread;
      std::array<float, kRingPerSector> lows, highs;
      lows.fill(low), highs.fill(high);
      for (std::size_t i = 0; i < kQuarter; ++i) {
        if (left) lows[i] = -kNoLimit, highs[i] = kNoLimit;
        if (right)
          lows[kRingPerSector - 1 - i] = -kNoLimit, highs[kRingPerSector - 1 - i] = kNoLimit;
      }
      int off = 0;
      for (std::size_t i = 0; i < kRingPerSector; ++i) {
        off |= static_cast<int>(v[i] < lows[i]) | static_cast<int>(v[i] > highs[i]);
      }
      if (off != 0) return false;
    }
  }
  return true;
}

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
bool MeasureChanges(const RingSamples& samples, const RingCircle& ring, const Sectors& s,
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
bool AgreeAcrossTheRing(const RingSamples& samples, const Sectors& s,
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

double WrongSector(const RingSamples& samples, const Sectors& s) {
  PerSector relative, sigma;
  for (std::size_t k = 0; k < static_cast<std::size_t>(s.n); ++k) {
    relative[k] = s.height[k] / s.light[k];
    // Pixels in the sector's middle half, from the blur's shares of it.
    const float pixels = 0.5f * samples.length_px[k] * samples.length_px[k] *
                         samples.blur_along[k] / samples.blur_across[k];
    const float noise = samples.grey_sigma / (s.light[k] * s.left[k]);
    sigma[k] = std::sqrt(noise * noise / std::max(1.0f, pixels) + kHeightSigma * kHeightSigma);
  }
  return WrongSectorProbability(relative.data(), sigma.data(), s.n);
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

/// Directions of the sectors' middles, from the first one's beginning.
struct SectorDirections {
  PerSector cosine = {}, sine = {};

  static const SectorDirections& Of(int n) {
    static const auto tables = [] {
      std::array<SectorDirections, kMaxCodeBits + 1> all;
      for (int m = 1; m <= kMaxCodeBits; ++m) {
        auto& table = all[static_cast<std::size_t>(m)];
        for (int k = 0; k < m; ++k) {
          const double t = 2 * std::numbers::pi * (k + 0.5) / m;
          table.cosine[static_cast<std::size_t>(k)] = static_cast<float>(std::cos(t));
          table.sine[static_cast<std::size_t>(k)] = static_cast<float>(std::sin(t));
        }
      }
      return all;
    }();
    return tables[static_cast<std::size_t>(n)];
  }
};

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
  SectorMeans<kRingPerSector>(samples.inner.data(), samples.num_bits, &inner);
  SectorMeans<kRingPerSector>(samples.middle.data(), samples.num_bits, &middle);
  SectorMeans<kRingPerSector>(samples.outer.data(), samples.num_bits, &outer);
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
                     ReadingDirection direction, double* phase) {
  RingReading reading;
  reading.status = RingStatus::kUnclear;
  RingCircle ring;
  MeanRing(samples, &ring);
  Sectors s;
  s.n = samples.num_bits;
  PerSector means;
  SectorMeans<kRingPerSector>(ring.data(), s.n, &means);
  Unblur(samples, means, &s);
  const auto& directions = SectorDirections::Of(s.n);
  if (!Divide(&s) || !IsEvenlyLit(directions.cosine, directions.sine, &s) || !IsClean(samples, s)) {
    return reading;
  }
  const double wrong = WrongSector(samples, s);
  reading.status = RingStatus::kEdgesOff;
  MeasuredChanges changes;
  if (!IsUniform(samples, s) || !MeasureChanges(samples, ring, s, &changes)) return reading;
  const double mean = RemovePhase(&changes);
  if (!AgreeAcrossTheRing(samples, s, changes, static_cast<float>(mean))) return reading;
  if (phase != nullptr) *phase = mean;
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

RingReading ReadRing(const GreyWindow& window, const TargetEdge& dot, const CodeFamily& family,
                     ReadingDirection direction) {
  RingReading reading;
  if (family.num_bits == 0) return reading;
  const int count = kBesidePerSector * family.num_bits;
  RingSampler sampler(window, dot, family);
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
  reading = ReadRing(samples, family, direction);
  if (reading.status != RingStatus::kUnclear && reading.status != RingStatus::kEdgesOff) {
    return reading;
  }
  const double scale = RingScale(samples, family, sampler.LargestScale());
  if (scale < kLeastScale) return reading;
  sampler.Scale(scale);
  if (!sampler.Sample(phase, &samples)) return reading;
  const RingReading again = ReadRing(samples, family, direction);
  return again.id ? again : reading;
}

}  // namespace videogrammetry
