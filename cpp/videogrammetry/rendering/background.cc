#include "videogrammetry/rendering/background.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "videogrammetry/rendering/random.h"

namespace videogrammetry {
namespace {

constexpr int kOctaves = 5;
constexpr double kCoarsestPx = 256.0;

/// A stream of uniform numbers of one seed.
class Stream {
 public:
  explicit Stream(std::uint64_t seed) : key_(MixedBits(seed ^ 0x5bd1e995u)) {}
  double Uniform(double low, double high) {
    return low + (high - low) * UniformOf(MixedBits(key_ + next_++));
  }

 private:
  std::uint64_t key_, next_ = 0;
};

/// Value noise: lattice values in -1 ... 1, cubic steps between them.
class CloudyNoise {
 public:
  CloudyNoise(std::uint64_t seed, double cell_px, int width)
      : key_(MixedBits(seed)), inverse_(1.0 / cell_px) {
    for (int x = 0; x < width; ++x) {
      const double place = x * inverse_, t = place - std::floor(place);
      column_.push_back({static_cast<int>(place), static_cast<float>(t * t * (3 - 2 * t))});
    }
    upper_.resize(static_cast<std::size_t>(width * inverse_) + 2);
  }

  void AddRow(int y, float amplitude, float* row) {
    const double place = y * inverse_, t = place - std::floor(place);
    const auto b = static_cast<float>(t * t * (3 - 2 * t));
    const auto line = static_cast<std::uint64_t>(place);
    for (std::size_t i = 0; i < upper_.size(); ++i) {
      const float top = Value(i, line), bottom = Value(i, line + 1);
      upper_[i] = top + b * (bottom - top);
    }
    for (std::size_t x = 0; x < column_.size(); ++x) {
      const auto [i, a] = column_[x];
      row[x] += amplitude * (upper_[i] + a * (upper_[i + 1] - upper_[i]));
    }
  }

 private:
  float Value(std::uint64_t i, std::uint64_t j) const {
    return static_cast<float>(2 * UniformOf(MixedBits(key_ + (j << 32) + i)) - 1);
  }

  std::uint64_t key_;
  double inverse_;
  std::vector<std::pair<int, float>> column_;
  std::vector<float> upper_;
};

void AddClouds(const Background& background, int width, int height, std::vector<float>* picture) {
  for (int octave = 0; octave < kOctaves; ++octave) {
    CloudyNoise noise(background.seed * kOctaves + octave, kCoarsestPx / (1 << octave), width);
    const auto amplitude = static_cast<float>(background.clutter * 0.55 / (1 << octave));
    for (int y = 0; y < height; ++y) {
      noise.AddRow(y, amplitude, picture->data() + static_cast<std::size_t>(y) * width);
    }
  }
}

/// A rectangle turned by `angle`, or a disc where half_b is 0.
struct Shape {
  double x, y, half_a, half_b, angle;
  float value;

  /// Signed distance, negative inside.
  double Distance(double px, double py, double c, double s) const {
    const double dx = px - x, dy = py - y;
    if (half_b == 0) return std::hypot(dx, dy) - half_a;
    const double a = std::abs(c * dx + s * dy) - half_a, b = std::abs(c * dy - s * dx) - half_b;
    return std::max(a, b);
  }

  void Paint(int width, int height, std::vector<float>* picture) const {
    const double c = std::cos(angle), s = std::sin(angle);
    const double reach_x = half_b == 0 ? half_a : std::abs(c) * half_a + std::abs(s) * half_b;
    const double reach_y = half_b == 0 ? half_a : std::abs(s) * half_a + std::abs(c) * half_b;
    const int x0 = std::max(0, static_cast<int>(x - reach_x) - 1);
    const int x1 = std::min(width, static_cast<int>(x + reach_x) + 3);
    const int y0 = std::max(0, static_cast<int>(y - reach_y) - 1);
    const int y1 = std::min(height, static_cast<int>(y + reach_y) + 3);
    for (int j = y0; j < y1; ++j) {
      float* row = picture->data() + static_cast<std::size_t>(j) * width;
      for (int i = x0; i < x1; ++i) {
        const auto share = static_cast<float>(std::clamp(0.5 - Distance(i, j, c, s), 0.0, 1.0));
        row[i] += share * (value - row[i]);
      }
    }
  }
};

void AddShapes(const Background& background, int width, int height, std::vector<float>* picture) {
  Stream random(background.seed);
  const auto value = [&] {
    const double v = background.level + background.clutter * random.Uniform(-1, 1);
    return static_cast<float>(std::clamp(v, 0.02, 1.0));
  };
  const double size = std::max(width, height);
  const auto paint = [&](int count, auto&& half_a, auto&& half_b) {
    for (int k = 0; k < count; ++k) {
      Shape shape{};
      shape.x = random.Uniform(0, width);
      shape.y = random.Uniform(0, height);
      shape.half_a = half_a();
      shape.half_b = half_b();
      shape.angle = random.Uniform(0, std::numbers::pi);
      shape.value = value();
      shape.Paint(width, height, picture);
    }
  };
  paint(
      background.num_patches, [&] { return random.Uniform(0.008, 0.05) * size; },
      [&] { return random.Uniform(0.008, 0.05) * size; });
  paint(
      background.num_lines, [&] { return random.Uniform(0.05, 0.35) * size; },
      [&] { return random.Uniform(0.8, 4.0); });
  paint(background.num_discs, [&] { return random.Uniform(3.0, 14.0); }, [] { return 0.0; });
}

}  // namespace

std::vector<float> PaintBackground(const Background& background, const LightField& light, int width,
                                   int height) {
  std::vector<float> picture(static_cast<std::size_t>(width) * height,
                             static_cast<float>(background.level));
  if (background.clutter > 0) {
    AddClouds(background, width, height, &picture);
    AddShapes(background, width, height, &picture);
  }
  for (int y = 0; y < height; ++y) {
    float* row = picture.data() + static_cast<std::size_t>(y) * width;
    for (int x = 0; x < width; ++x) {
      row[x] = static_cast<float>(std::clamp(row[x], 0.01f, 1.0f) * light.At(x, y));
    }
  }
  return picture;
}

void AddSpots(const std::vector<SpecularSpot>& spots, double psf_sigma_px, int width, int height,
              std::vector<float>* picture) {
  for (const SpecularSpot& spot : spots) {
    const double variance = spot.sigma_px * spot.sigma_px + psf_sigma_px * psf_sigma_px;
    // The lens keeps the light: a wider spot is lower.
    const double top = spot.amplitude * spot.sigma_px * spot.sigma_px / variance;
    const double reach = 5 * std::sqrt(variance);
    const auto clip = [](double v, int size) {
      return static_cast<int>(std::clamp(v, 0.0, static_cast<double>(size)));
    };
    for (int y = clip(spot.y_px - reach, height); y < clip(spot.y_px + reach + 1, height); ++y) {
      float* row = picture->data() + static_cast<std::size_t>(y) * width;
      for (int x = clip(spot.x_px - reach, width); x < clip(spot.x_px + reach + 1, width); ++x) {
        const double dx = x - spot.x_px, dy = y - spot.y_px;
        row[x] += static_cast<float>(top * std::exp(-0.5 * (dx * dx + dy * dy) / variance));
      }
    }
  }
}

}  // namespace videogrammetry
