#include "videogrammetry/recognition/contour.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace videogrammetry {
namespace {

/// Sides walked between two looks at the limits; a power of two.
constexpr std::ptrdiff_t kCheckEvery = 8;
/// Sides allowed beyond those of the bounding box, for the smallest regions.
constexpr std::ptrdiff_t kSlack = 6;

}  // namespace

template <typename T>
ContourFollower<T>::ContourFollower(const SignedImage<T>& image, int max_extent_px)
    : image_(image),
      max_extent_px_(max_extent_px),
      // The box may be passed by what is walked between two looks.
      sides_(static_cast<std::size_t>(5 * (max_extent_px + kCheckEvery) + kSlack + kCheckEvery)) {}

template <typename T>
bool ContourFollower<T>::Exceeds(std::ptrdiff_t count) const {
  const int width = max_u_ - min_u_, height = max_v_ - min_v_;
  return 2 * (count - kSlack) > 5 * (width + height) || std::max(width, height) > max_extent_px_;
}

template <typename T>
ContourEnd ContourFollower<T>::Follow(const int x, const int y, const int level) {
  // Without branches on the grey values: they would be mispredicted at every
  // other side. By direction: the step, and the pixels ahead on the right and
  // on the left of a corner, whose own pixel is the one to its lower right.
  constexpr int kDu[4] = {0, 1, 0, -1}, kDv[4] = {-1, 0, 1, 0};
  const std::ptrdiff_t row = image_.view().stride();
  const std::ptrdiff_t steps[4] = {-row, 1, row, -1};
  const std::ptrdiff_t right_ahead[4] = {-row, 0, -1, -row - 1};
  const std::ptrdiff_t left_ahead[4] = {-row - 1, -row, 0, -1};
  constexpr int kTurn[4] = {1, 1, 0, 3};  // by 2 * (right inside) + (left inside)
  const int sign = image_.sign();
  const auto columns = static_cast<unsigned>(image_.width() - 1);
  const auto rows = static_cast<unsigned>(image_.height() - 1);

  base_x_ = x;
  base_y_ = y + 1;
  min_u_ = max_u_ = min_v_ = max_v_ = 0;
  const T* corner = image_.row(y) + x + row;
  Side* side = sides_.data();
  int u = 0, v = 0, direction = 0;
  do {
    u += kDu[direction];
    v += kDv[direction];
    corner += steps[direction];
    *side++ = {static_cast<std::int16_t>(u), static_cast<std::int16_t>(v),
               static_cast<std::int16_t>(direction)};
    min_u_ = std::min(min_u_, u);
    max_u_ = std::max(max_u_, u);
    min_v_ = std::min(min_v_, v);
    max_v_ = std::max(max_v_, v);
    if (static_cast<unsigned>(base_x_ + u - 1) >= columns ||
        static_cast<unsigned>(base_y_ + v - 1) >= rows) {
      count_ = side - sides_.data();
      return ContourEnd::kLeavesImage;
    }
    if (((side - sides_.data()) & (kCheckEvery - 1)) == 0 && Exceeds(side - sides_.data())) {
      count_ = side - sides_.data();
      return ContourEnd::kExceeds;
    }
    const int right = sign * static_cast<int>(corner[right_ahead[direction]]) >= level;
    const int left = sign * static_cast<int>(corner[left_ahead[direction]]) >= level;
    direction = (direction + kTurn[2 * right + left]) & 3;
  } while (u != 0 || v != 0 || direction != 0);
  count_ = side - sides_.data();
  return Exceeds(count_) ? ContourEnd::kExceeds : ContourEnd::kClosed;
}

template <typename T>
ContourMoments ContourFollower<T>::Moments() const {
  // A vertical side at s from v - dy to v, its middle at w; down is positive.
  double a = 0, ax = 0, ay = 0, axx = 0, axy = 0, ayy = 0;
  for (std::ptrdiff_t i = 0; i < count_; ++i) {
    const Side& side = sides_[static_cast<std::size_t>(i)];
    if ((side.direction & 1) != 0) continue;
    const double dy = side.direction - 1, s = side.u, w = side.v - 0.5 * dy;
    a += s * dy;
    ax += 0.5 * s * s * dy;
    ay += s * w * dy;
    axx += s * s * s / 3.0 * dy;
    axy += 0.5 * s * s * w * dy;
    ayy += s * (w * w + 1.0 / 12.0) * dy;
  }
  ContourMoments m;
  m.width_px = max_u_ - min_u_;
  m.height_px = max_v_ - min_v_;
  m.area = a;
  const double mx = ax / a, my = ay / a;
  // Corner (0, 0) is the point (base_x - 1/2, base_y - 1/2); a pixel's own
  // extent adds 1/12 to the variances.
  m.mean_x = base_x_ - 0.5 + mx;
  m.mean_y = base_y_ - 0.5 + my;
  m.var_xx = axx / a - mx * mx - 1.0 / 12.0;
  m.var_xy = axy / a - mx * my;
  m.var_yy = ayy / a - my * my - 1.0 / 12.0;
  return m;
}

std::optional<Ellipse> EllipseFromMoments(const ContourMoments& m) {
  const double half_trace = 0.5 * (m.var_xx + m.var_yy);
  const double half_difference = 0.5 * (m.var_xx - m.var_yy);
  const double root = std::hypot(half_difference, m.var_xy);
  const double large = half_trace + root, small = half_trace - root;
  if (!(small > 0.0)) return std::nullopt;
  Ellipse ellipse;
  ellipse.x_px = m.mean_x;
  ellipse.y_px = m.mean_y;
  ellipse.semi_major_px = 2.0 * std::sqrt(large);
  ellipse.semi_minor_px = 2.0 * std::sqrt(small);
  double angle = 0.5 * std::atan2(m.var_xy, half_difference);
  if (angle < 0) angle += std::numbers::pi;
  ellipse.angle_rad = angle;
  return ellipse;
}

double EllipseLikeness(const ContourMoments& m) {
  const double determinant = m.var_xx * m.var_yy - m.var_xy * m.var_xy;
  if (!(determinant > 0.0)) return 0.0;
  return m.area / (4.0 * std::numbers::pi * std::sqrt(determinant));
}

template class ContourFollower<std::uint8_t>;
template class ContourFollower<std::uint16_t>;

}  // namespace videogrammetry
