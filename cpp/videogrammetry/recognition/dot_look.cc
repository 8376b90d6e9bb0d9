#include "videogrammetry/recognition/dot_look.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

namespace videogrammetry {
namespace {

/// Widths of the edge that a plateau keeps clear of, and the ground looked at beyond.
constexpr double kEdge = 2.5, kGroundPx = 3.0;
constexpr float kDeep = 0.6f;  ///< inner places, in minor axes from the contour

constexpr int kPlaces = 16;

using Places = std::array<float, kPlaces>;

struct DirectionTable {
  Places cosine, sine;
};

const DirectionTable& Directions() {
  static const auto directions = [] {
    DirectionTable table;
    for (std::size_t i = 0; i < kPlaces; ++i) {
      const double t = 2 * std::numbers::pi * static_cast<double>(i) / kPlaces;
      table.cosine[i] = static_cast<float>(std::cos(t));
      table.sine[i] = static_cast<float>(std::sin(t));
    }
    return table;
  }();
  return directions;
}

/// Grey values at some distances from the ellipse, in the directions of its normals.
template <std::size_t kDistances>
using Around = std::array<Places, kDistances>;

/// @return false if the picture ends before.
template <std::size_t kDistances>
bool SampleAround(const GreySampler& picture, const EllipseFrame& frame,
                  const std::array<float, kDistances>& distances_px, Around<kDistances>* grey) {
  const Eigen::Matrix2d& e = frame.shape;
  const double most = *std::max_element(distances_px.begin(), distances_px.end()) + 0.01;
  const double reach_x = std::sqrt(e(0, 0) * e(0, 0) + e(0, 1) * e(0, 1)) + most;
  const double reach_y = std::sqrt(e(0, 1) * e(0, 1) + e(1, 1) * e(1, 1)) + most;
  const double cx = frame.center.x(), cy = frame.center.y();
  if (!picture.Covers(cx - reach_x, cy - reach_y) || !picture.Covers(cx + reach_x, cy + reach_y)) {
    return false;
  }
  // Coordinates count from the upper left corner.
  const double left = std::floor(cx - reach_x), top = std::floor(cy - reach_y);
  const auto exx = static_cast<float>(e(0, 0)), exy = static_cast<float>(e(0, 1)),
             eyy = static_cast<float>(e(1, 1));
  const auto x0 = static_cast<float>(cx - left), y0 = static_cast<float>(cy - top);
  const Places &ux = Directions().cosine, &uy = Directions().sine;
  Places nx, ny, px, py;
  for (std::size_t k = 0; k < kPlaces; ++k) {
    nx[k] = eyy * ux[k] - exy * uy[k];
    ny[k] = exx * uy[k] - exy * ux[k];
    const float length = 1.0f / std::sqrt(nx[k] * nx[k] + ny[k] * ny[k]);
    nx[k] *= length;
    ny[k] *= length;
    px[k] = x0 + (exx * ux[k] + exy * uy[k]);
    py[k] = y0 + (exy * ux[k] + eyy * uy[k]);
  }
  Around<kDistances> x, y;
  for (std::size_t i = 0; i < kDistances; ++i) {
    for (std::size_t k = 0; k < kPlaces; ++k) {
      x[i][k] = px[k] + distances_px[i] * nx[k];
      y[i][k] = py[k] + distances_px[i] * ny[k];
    }
  }
  picture.Sample(static_cast<int>(left), static_cast<int>(top), static_cast<int>(cy + reach_y) + 1,
                 x[0].data(), y[0].data(), static_cast<int>(kDistances * kPlaces),
                 (*grey)[0].data());
  return true;
}

/// Batcher's network that sorts kPlaces values without a branch: pairs to be put in order.
constexpr std::size_t kExchanges = 63;
constexpr auto kNetwork = [] {
  std::array<std::array<std::size_t, 2>, kExchanges> pairs = {};
  std::size_t at = 0;
  for (std::size_t p = 1; p < kPlaces; p *= 2) {
    for (std::size_t k = p; k >= 1; k /= 2) {
      for (std::size_t j = k % p; j + k < kPlaces; j += 2 * k) {
        for (std::size_t i = j; i < j + k && i + k < kPlaces; ++i) {
          if (i / (2 * p) == (i + k) / (2 * p)) pairs[at++] = {i, i + k};
        }
      }
    }
  }
  return pairs;
}();

template <std::size_t... kSteps>
inline void Sort(std::index_sequence<kSteps...>, Places* v) {
  const auto exchange = [v](std::size_t i, std::size_t j) {
    const float a = (*v)[i], b = (*v)[j];
    (*v)[i] = a < b ? a : b;
    (*v)[j] = a < b ? b : a;
  };
  (exchange(kNetwork[kSteps][0], kNetwork[kSteps][1]), ...);
}

/// The upper of the two middle values.
float Median(Places grey) {
  Sort(std::make_index_sequence<kExchanges>(), &grey);
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

bool MeasureGrey(const GreySampler& picture, DotStart* dot) {
  constexpr int kMayFail = 1;
  constexpr float kNearPx = 1.25f, kFarPx = 2.25f;
  const Eigen::Matrix2d& e = dot->frame.shape;
  // (not less than the minor axis)
  const auto minor = static_cast<float>(e.determinant() / std::max(e(0, 0), e(1, 1)));
  Around<4> grey;
  const std::array<float, 4> distances = {-kDeep * minor, -std::min(1.5f, 0.6f * minor), kNearPx,
                                          kFarPx};
  if (!SampleAround(picture, dot->frame, distances, &grey)) return false;
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
