#include "videogrammetry/recognition/ring_sectors.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "videogrammetry/recognition/ring_confidence.h"

namespace videogrammetry {
namespace {

/// Standard deviation of a sector's height that noise does not explain.
constexpr float kHeightSigma = 0.07f;
constexpr float kNoLimit = std::numeric_limits<float>::infinity();
/// How far single samples may be from what their sector is, as a part of the
/// light, and in standard deviations of the noise.
constexpr float kUniform = 0.25f;
constexpr float kNoiseTimes = 4.5f;
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

/// Heights of the print from the sectors' means h: h_k = (1 - 2 l_k) b_k + l_k (b_k-1 +
/// b_k+1) solved by Jacobi's iteration (l <= 0.22: it converges), then over what
/// the ring's narrowness leaves.
void Unblur(const RingSamples& samples, const PerSector& means, RingSectors* s) {
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
bool Divide(RingSectors* s) {
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
bool IsEvenlyLit(const PerSector& cosine, const PerSector& sine, RingSectors* s) {
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
bool IsClean(const RingSamples& samples, const RingSectors& s) {
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

}  // namespace

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

void MeanSectors(const RingCircle& circle, int num_bits, PerSector* means) {
  SectorMeans<kRingPerSector>(circle.data(), num_bits, means);
}

bool MeasureSectors(const RingSamples& samples, const RingCircle& ring, RingSectors* s) {
  s->n = samples.num_bits;
  PerSector means;
  MeanSectors(ring, s->n, &means);
  Unblur(samples, means, s);
  const auto& directions = SectorDirections::Of(s->n);
  return Divide(s) && IsEvenlyLit(directions.cosine, directions.sine, s) && IsClean(samples, *s);
}

bool IsUniform(const RingSamples& samples, const RingSectors& s) {
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

double WrongSectorProbability(const RingSamples& samples, const RingSectors& s) {
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

}  // namespace videogrammetry
