#include "videogrammetry/recognition/edge_points.h"

#include <array>
#include <cstdint>
#include <optional>

namespace videogrammetry {
namespace {

constexpr int kHalf = 4;  // samples on either side
constexpr float kStep = 0.5f;

/// Distance of the edge from the pixel along its normal.
template <typename T>
std::optional<double> MeanGradientOffset(const SignedImage<T>& image, const EdgePixel& edge) {
  constexpr int kSamples = 2 * kHalf + 1;
  std::array<float, kSamples> x, y, value;
  for (int k = 0; k < kSamples; ++k) {
    const float d = kStep * static_cast<float>(k - kHalf);
    x[static_cast<std::size_t>(k)] = static_cast<float>(edge.x) + d * edge.normal_x;
    y[static_cast<std::size_t>(k)] = static_cast<float>(edge.y) + d * edge.normal_y;
  }
  constexpr double kReach = kStep * kHalf;
  if (image.CoversAround(edge.x, edge.y, kReach, kReach)) {
    image.Sample(x.data(), y.data(), kSamples, value.data());
  } else {
    for (std::size_t k = 0; k < value.size(); ++k) value[k] = image.Bilinear(x[k], y[k]);
  }
  std::array<float, 2 * kHalf> fall;  // fall[k]: from d_k to d_k+1
  for (std::size_t k = 0; k < fall.size(); ++k) fall[k] = value[k] - value[k + 1];
  std::size_t peak = kHalf - 2;
  for (std::size_t k = kHalf - 2; k <= kHalf + 1; ++k) {
    if (fall[k] > fall[peak]) peak = k;
  }
  if (!(fall[peak] > 0)) return std::nullopt;
  const float least = 0.1f * fall[peak];
  std::size_t first = peak, last = peak;
  while (first > 0 && fall[first - 1] > least) --first;
  while (last + 1 < fall.size() && fall[last + 1] > least) ++last;
  double weight = 0, moment = 0;
  for (std::size_t k = first; k <= last; ++k) {
    weight += fall[k];
    moment += fall[k] * kStep * (static_cast<double>(k) + 0.5 - kHalf);
  }
  return moment / weight;
}

}  // namespace

template <typename T>
Points2d MeanGradientPoints(const SignedImage<T>& image, const std::vector<EdgePixel>& edges) {
  Points2d points(static_cast<Eigen::Index>(edges.size()), 2);
  Eigen::Index count = 0;
  constexpr double kReach = 1.5;  // beyond it the border value goes on
  for (const EdgePixel& edge : edges) {
    if (!image.Covers(edge.x - kReach, edge.y - kReach) ||
        !image.Covers(edge.x + kReach, edge.y + kReach)) {
      continue;
    }
    const auto offset = MeanGradientOffset(image, edge);
    if (!offset) continue;
    points.row(count++) << edge.x + *offset * edge.normal_x, edge.y + *offset * edge.normal_y;
  }
  points.conservativeResize(count, 2);
  return points;
}

template Points2d MeanGradientPoints(const SignedImage<std::uint8_t>&,
                                     const std::vector<EdgePixel>&);
template Points2d MeanGradientPoints(const SignedImage<std::uint16_t>&,
                                     const std::vector<EdgePixel>&);

}  // namespace videogrammetry
