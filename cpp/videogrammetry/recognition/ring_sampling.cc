#include "videogrammetry/recognition/ring_sampling.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "videogrammetry/recognition/ellipse_fit.h"

namespace videogrammetry {

template <typename T>
std::vector<float> SampleCircle(const SignedImage<T>& image, const TargetEdge& dot, double radius,
                                int count) {
  const EllipseFrame frame = EllipseFrame::From(dot.ellipse);
  const Eigen::Matrix2d scaled = radius * frame.shape;
  const Eigen::Vector2d reach = scaled.rowwise().norm();
  const double scale = 1.0 / (dot.inside - dot.outside);
  const Eigen::Matrix2d next = Eigen::Rotation2Dd(2 * std::numbers::pi / count).toRotationMatrix();
  Eigen::Vector2d u(1.0, 0.0);
  std::vector<float> x(static_cast<std::size_t>(count)), y(x.size()), values(x.size());
  for (std::size_t k = 0; k < x.size(); ++k, u = next * u) {
    const Eigen::Vector2d p = frame.center + scaled * u;
    x[k] = static_cast<float>(p.x());
    y[k] = static_cast<float>(p.y());
  }
  if (image.CoversAround(frame.center.x(), frame.center.y(), reach.x(), reach.y())) {
    image.Sample(x.data(), y.data(), count, values.data());
  } else {
    for (std::size_t k = 0; k < x.size(); ++k) {
      values[k] = image.Covers(x[k], y[k]) ? image.Bilinear(x[k], y[k])
                                           : std::numeric_limits<float>::quiet_NaN();
    }
  }
  for (float& value : values) value = static_cast<float>((value - dot.outside) * scale);
  return values;
}

template <typename T>
std::optional<RingSamples> SampleRing(const SignedImage<T>& image, const TargetEdge& dot,
                                      double ring_inner, double ring_outer, int num_bits) {
  constexpr int kPerSector = 12;
  const double width = ring_outer - ring_inner;
  const int count = kPerSector * num_bits;
  RingSamples s;
  s.per_sector = kPerSector;
  s.inner = SampleCircle(image, dot, ring_inner + 0.2 * width, count);
  if (std::any_of(s.inner.begin(), s.inner.end(), [](float v) { return std::isnan(v); })) {
    return std::nullopt;
  }
  s.gap = SampleCircle(image, dot, 1.0 + 0.55 * (ring_inner - 1.0), count);
  s.middle = SampleCircle(image, dot, ring_inner + 0.5 * width, count);
  s.outer = SampleCircle(image, dot, ring_outer - 0.2 * width, count);
  s.outside = SampleCircle(image, dot, ring_outer + 0.2 * width, count);
  return s;
}

#define VG_INSTANTIATE(T)                                                                          \
  template std::vector<float> SampleCircle(const SignedImage<T>&, const TargetEdge&, double, int); \
  template std::optional<RingSamples> SampleRing(const SignedImage<T>&, const TargetEdge&, double, \
                                                 double, int);
VG_INSTANTIATE(std::uint8_t)
VG_INSTANTIATE(std::uint16_t)
#undef VG_INSTANTIATE

}  // namespace videogrammetry
