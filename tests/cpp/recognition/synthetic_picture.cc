#include "synthetic_picture.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace videogrammetry::testing {
namespace {

constexpr int kPoints = 8;

bool IsBright(const Drawn& shape, double x, double y) {
  const Ellipse& e = shape.ellipse;
  const double c = std::cos(e.angle_rad), s = std::sin(e.angle_rad);
  const double u = (c * (x - e.x_px) + s * (y - e.y_px)) / e.semi_major_px;
  const double v = (-s * (x - e.x_px) + c * (y - e.y_px)) / e.semi_minor_px;
  const double radius = std::hypot(u, v);
  if (radius <= 1.0) return true;
  if (shape.bits.empty() || radius < shape.ring_inner || radius > shape.ring_outer) return false;
  const auto n = static_cast<int>(shape.bits.size());
  // Turned back by the axes' direction: R diag R^T maps the circle without a turn.
  const double t = std::atan2(s * u + c * v, c * u - s * v) - shape.turn_rad;
  const int sector = static_cast<int>(std::floor(t / (2 * std::numbers::pi) * n));
  return shape.bits[static_cast<std::size_t>(((sector % n) + n) % n)] != 0;
}

void AddCoverage(const Drawn& shape, int width, int height, std::vector<double>* coverage) {
  const Ellipse& e = shape.ellipse;
  const double reach = e.semi_major_px * (shape.bits.empty() ? 1.0 : shape.ring_outer) + 1;
  const int x0 = std::max(0, static_cast<int>(e.x_px - reach));
  const int x1 = std::min(width - 1, static_cast<int>(e.x_px + reach) + 1);
  const int y0 = std::max(0, static_cast<int>(e.y_px - reach));
  const int y1 = std::min(height - 1, static_cast<int>(e.y_px + reach) + 1);
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      int bright = 0;
      for (int k = 0; k < kPoints * kPoints; ++k) {
        const double px = x - 0.5 + (k % kPoints + 0.5) / kPoints;
        const double py = y - 0.5 + (k / kPoints + 0.5) / kPoints;
        bright += IsBright(shape, px, py);
      }
      double& value = (*coverage)[static_cast<std::size_t>(y * width + x)];
      value = std::max(value, static_cast<double>(bright) / (kPoints * kPoints));
    }
  }
}

std::vector<double> Blurred(const std::vector<double>& in, int width, int height, int step_x,
                            int step_y) {
  std::vector<double> out(in.size());
  const auto at = [&](int x, int y) {
    x = std::clamp(x, 0, width - 1);
    y = std::clamp(y, 0, height - 1);
    return in[static_cast<std::size_t>(y * width + x)];
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      out[static_cast<std::size_t>(y * width + x)] =
          0.25 * at(x - step_x, y - step_y) + 0.5 * at(x, y) + 0.25 * at(x + step_x, y + step_y);
    }
  }
  return out;
}

}  // namespace

Picture<std::uint16_t> Render(int width, int height, const std::vector<Drawn>& shapes,
                              double bright, double dark, double noise_sigma, unsigned seed) {
  std::vector<double> coverage(static_cast<std::size_t>(width * height), 0.0);
  for (const Drawn& shape : shapes) AddCoverage(shape, width, height, &coverage);
  coverage = Blurred(Blurred(coverage, width, height, 1, 0), width, height, 0, 1);
  Picture<std::uint16_t> picture{width, height, std::vector<std::uint16_t>(coverage.size())};
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0.0, 1.0);
  for (std::size_t i = 0; i < coverage.size(); ++i) {
    const double grey = dark + (bright - dark) * coverage[i] + noise_sigma * noise(random);
    picture.pixels[i] = static_cast<std::uint16_t>(std::clamp(std::lround(grey), 0L, 65535L));
  }
  return picture;
}

std::vector<int> Bits(std::uint32_t code, int num_bits) {
  std::vector<int> bits;
  for (int i = num_bits - 1; i >= 0; --i) bits.push_back(static_cast<int>((code >> i) & 1));
  return bits;
}

}  // namespace videogrammetry::testing
