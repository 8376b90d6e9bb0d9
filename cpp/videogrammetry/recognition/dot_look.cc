#include "videogrammetry/recognition/dot_look.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace videogrammetry {
namespace {

/// Widths of the edge that a plateau keeps clear of, and the ground looked at beyond.
constexpr double kEdge = 2.5, kGroundPx = 3.0;
constexpr double kDeep = 0.6;  ///< inner places, in minor axes from the contour

constexpr int kPlaces = 16;

const std::array<Eigen::Vector2d, kPlaces>& Directions() {
  static const auto directions = [] {
    std::array<Eigen::Vector2d, kPlaces> u;
    for (int i = 0; i < kPlaces; ++i) {
      const double t = 2 * std::numbers::pi * i / kPlaces;
      u[static_cast<std::size_t>(i)] = {std::cos(t), std::sin(t)};
    }
    return u;
  }();
  return directions;
}

/// Grey values at some distances from the ellipse, in the directions of its normals.
template <std::size_t kDistances>
using Around = std::array<std::array<float, kPlaces>, kDistances>;

/// @return false if the window ends before.
template <std::size_t kDistances>
bool SampleAround(const GreyWindow& window, const EllipseFrame& frame,
                  const std::array<double, kDistances>& distances_px, Around<kDistances>* grey) {
  const Eigen::Matrix2d& e = frame.shape;
  Around<kDistances> x, y;
  double left = 1e9, right = -1e9, top = 1e9, bottom = -1e9;
  for (std::size_t k = 0; k < kPlaces; ++k) {
    const double ux = Directions()[k].x(), uy = Directions()[k].y();
    const double nx = e(1, 1) * ux - e(0, 1) * uy, ny = e(0, 0) * uy - e(0, 1) * ux;
    const double length = 1.0 / std::sqrt(nx * nx + ny * ny);
    const double px = frame.center.x() + e(0, 0) * ux + e(0, 1) * uy;
    const double py = frame.center.y() + e(0, 1) * ux + e(1, 1) * uy;
    for (std::size_t i = 0; i < kDistances; ++i) {
      const double qx = px + distances_px[i] * length * nx;
      const double qy = py + distances_px[i] * length * ny;
      x[i][k] = static_cast<float>(qx);
      y[i][k] = static_cast<float>(qy);
      left = std::min(left, qx);
      right = std::max(right, qx);
      top = std::min(top, qy);
      bottom = std::max(bottom, qy);
    }
  }
  if (!window.Covers(left, top) || !window.Covers(right, bottom)) return false;
  window.Sample(x[0].data(), y[0].data(), static_cast<int>(kDistances * kPlaces),
                (*grey)[0].data());
  return true;
}

float Median(std::array<float, kPlaces> grey) {
  std::nth_element(grey.begin(), grey.begin() + kPlaces / 2, grey.end());
  return grey[kPlaces / 2];
}

/// A plane through grey values: a + g . v.
class Plane {
 public:
  void Add(const Eigen::Vector2d& v, double grey) {
    const Eigen::Vector3d row(1.0, v.x(), v.y());
    normal_ += row * row.transpose();
    right_ += grey * row;
    squares_ += grey * grey;
    count_ += 1;
  }
  /// @return false if the pixels are too few to tell.
  bool Solve() {
    if (count_ < kLeastPixels) return false;
    const Eigen::Matrix3d inverse = normal_.inverse();
    const Eigen::Vector3d x = inverse * right_;
    const double variance = std::max(1.0 / 12.0, (squares_ - x.dot(right_)) / (count_ - 3));
    level = x[0];
    gradient = x.tail<2>();
    noise = 0.5 * variance * (inverse(1, 1) + inverse(2, 2));
    return true;
  }

  double level = 0.0;
  Eigen::Vector2d gradient = Eigen::Vector2d::Zero();
  double noise = 0.0;  ///< variance of the gradient's coordinates

 private:
  static constexpr int kLeastPixels = 24;
  Eigen::Matrix3d normal_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right_ = Eigen::Vector3d::Zero();
  double squares_ = 0.0;
  int count_ = 0;
};

}  // namespace

bool MeasureGrey(const GreyWindow& window, DotStart* dot) {
  constexpr int kMayFail = 1;
  constexpr double kNearPx = 1.25, kFarPx = 2.25;
  const Eigen::Matrix2d& e = dot->frame.shape;
  // (not less than the minor axis)
  const double minor = e.determinant() / std::max(e(0, 0), e(1, 1));
  Around<4> grey;
  const std::array<double, 4> distances = {-kDeep * minor, -std::min(1.5, 0.6 * minor), kNearPx,
                                           kFarPx};
  if (!SampleAround(window, dot->frame, distances, &grey)) return false;
  const auto& [deep, in, out, far] = grey;
  dot->inside = Median(deep);
  // On a narrow dark rim the nearer one is the dot's ground.
  dot->outside = std::min(Median(out), Median(far));
  const auto least = static_cast<float>(0.25 * (dot->inside - dot->outside));
  if (!(least > 0.0f)) return false;
  int failed = 0;
  for (std::size_t k = 0; k < kPlaces; ++k) failed += in[k] - out[k] < least;
  return failed <= kMayFail;
}

void Resize(double level, double blur_px, DotStart* dot) {
  const double part = std::clamp((level - dot->outside) / (dot->inside - dot->outside), 0.05, 0.95);
  const double inward = 0.59 * blur_px * std::log(part / (1.0 - part));
  Eigen::Matrix2d& e = dot->frame.shape;
  const double least = 0.5 * std::sqrt(std::max(0.0, e.determinant()));
  if (e(0, 0) + inward < least || e(1, 1) + inward < least) return;
  e(0, 0) += inward;
  e(1, 1) += inward;
}

std::optional<FlareSample> MeasureFlare(const GreyWindow& window, const ModelFit& fit) {
  const EllipseFrame frame = EllipseFrame::From(fit.ellipse);
  const Eigen::Matrix2d inverse = frame.shape.inverse();
  // A plateau is free of the edge, and of that of a ring a radius away, from 2.5 s on.
  const double edge = kEdge * fit.blur_px / fit.ellipse.semi_minor_px;
  const double ground = std::min(2.0 - edge, 1.0 + edge + kGroundPx / fit.ellipse.semi_minor_px);
  Plane inside, outside;
  for (int y = window.y0; y < window.y0 + window.height; ++y) {
    for (int x = window.x0; x < window.x0 + window.width; ++x) {
      const Eigen::Vector2d v = inverse * (Eigen::Vector2d(x, y) - frame.center);
      const double radius = v.norm(), grey = static_cast<double>(window(x, y));
      if (radius < 1.0 - edge) inside.Add(v, grey - fit.inside);
      if (radius > 1.0 + edge && radius < ground) outside.Add(v, grey - fit.outside);
    }
  }
  if (!inside.Solve() || !outside.Solve()) return std::nullopt;
  const bool bright_inside = std::abs(fit.inside) >= std::abs(fit.outside);
  const Plane& bright = bright_inside ? inside : outside;
  const Plane& dark = bright_inside ? outside : inside;
  const double share = bright_inside ? fit.outside / fit.inside : fit.inside / fit.outside;
  const double contrast = fit.inside - fit.outside, unit = 1.0 / (contrast * contrast);
  return FlareSample{unit * (dark.gradient - share * bright.gradient).squaredNorm(),
                     unit * (dark.noise + share * share * bright.noise)};
}

}  // namespace videogrammetry
