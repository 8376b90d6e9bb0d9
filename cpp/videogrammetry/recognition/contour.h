#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <optional>

#include "videogrammetry/geometry/conic.h"
#include "videogrammetry/recognition/signed_image.h"

namespace videogrammetry {

/// Limits that end a contour early.
struct ContourLimits {
  int max_extent_px = 200;  ///< width and height of the bounding box
  /// Sides walked over those of the bounding box so far: 1 for a convex region,
  /// whose walk is monotonous in both directions between its extremes.
  double max_raggedness = 1.3;
};

enum class ContourEnd {
  kClosed,       ///< came back to its start
  kTooLong,      ///< exceeds the limits: no target (too large, or ragged)
  kLeavesImage,  ///< touches the picture's border
};

/// Area moments of a region of pixels, from the walk around its border.
struct ContourMoments {
  ContourEnd end = ContourEnd::kTooLong;
  int steps = 0;
  int min_x = 0, max_x = 0, min_y = 0, max_y = 0;  ///< pixels, inclusive
  double area = 0.0;
  double mean_x = 0.0, mean_y = 0.0;
  double var_xx = 0.0, var_xy = 0.0, var_yy = 0.0;  ///< of pixel centres
};

/// Walks around the 4-connected region of grey values >= level that holds the
/// pixel (x, y), whose left neighbour lies outside the region.
///
/// The walk follows the sides between pixels with the region on the right hand
/// (up along the left border first). Green's theorem turns the sides into
/// area, mean and second moments; only the vertical ones contribute.
///
/// @param on_left_side  called with (x, y) of each pixel whose left side is walked upwards.
template <typename T, typename OnLeftSide>
ContourMoments FollowContour(const SignedImage<T>& image, int x, int y, int level,
                             const ContourLimits& limits, OnLeftSide&& on_left_side);

/// The ellipse with the same second moments: semi axes 2 sqrt(eigenvalue).
/// @return nullopt for a region without extent.
std::optional<Ellipse> EllipseFromMoments(const ContourMoments& moments);

/// Area over the area of the ellipse with the same second moments: 1 for an
/// ellipse, 0.955 for any parallelogram, less for all that is ragged or concave.
double EllipseLikeness(const ContourMoments& moments);

template <typename T, typename OnLeftSide>
ContourMoments FollowContour(const SignedImage<T>& image, const int x, const int y, const int level,
                             const ContourLimits& limits, OnLeftSide&& on_left_side) {
  ContourMoments m;
  m.min_x = m.max_x = x;
  m.min_y = m.max_y = y;
  const auto inside = [&](int px, int py) {
    return image.view().contains(px, py) && image(px, py) >= level;
  };
  // Directions: 0 up, 1 right, 2 down, 3 left. (u, v) is the corner relative
  // to the start's bottom-left one; the corner's pixel is to its lower right.
  constexpr int kDx[4] = {0, 1, 0, -1}, kDy[4] = {-1, 0, 1, 0};
  // Pixel ahead on the right and on the left, from the corner reached.
  constexpr int kRightX[4] = {0, 0, -1, -1}, kRightY[4] = {-1, 0, 0, -1};
  constexpr int kLeftX[4] = {-1, 0, 0, -1}, kLeftY[4] = {-1, -1, 0, 0};
  int u = 0, v = 0, direction = 0;
  double a = 0, ax = 0, ay = 0, axx = 0, axy = 0, ayy = 0;
  const int base_x = x, base_y = y + 1;
  do {
    u += kDx[direction];
    v += kDy[direction];
    if (direction == 0 || direction == 2) {
      // Side from (u, v - dy) to (u, v), its middle at (s, w); down is positive.
      const double dy = kDy[direction], s = u, w = v - 0.5 * dy;
      a += s * dy;
      ax += 0.5 * s * s * dy;
      ay += s * w * dy;
      axx += s * s * s / 3.0 * dy;
      axy += 0.5 * s * s * w * dy;
      ayy += s * (w * w + 1.0 / 12.0) * dy;
      if (direction == 0) {
        const int px = base_x + u, py = base_y + v;
        m.min_x = std::min(m.min_x, px);
        on_left_side(px, py);
      } else {
        m.max_x = std::max(m.max_x, base_x + u - 1);
      }
    } else if (direction == 1) {
      m.min_y = std::min(m.min_y, base_y + v);
    } else {
      m.max_y = std::max(m.max_y, base_y + v - 1);
    }
    const int width = m.max_x - m.min_x + 1, height = m.max_y - m.min_y + 1;
    if (++m.steps > limits.max_raggedness * 2 * (width + height) + 4 ||
        width > limits.max_extent_px || height > limits.max_extent_px) {
      m.end = ContourEnd::kTooLong;
      return m;
    }
    const int cx = base_x + u, cy = base_y + v;
    if (!inside(cx + kRightX[direction], cy + kRightY[direction])) {
      direction = (direction + 1) & 3;
    } else if (inside(cx + kLeftX[direction], cy + kLeftY[direction])) {
      direction = (direction + 3) & 3;
    }
  } while (u != 0 || v != 0 || direction != 0);

  m.end = m.min_x <= 0 || m.min_y <= 0 || m.max_x >= image.width() - 1 ||
                  m.max_y >= image.height() - 1
              ? ContourEnd::kLeavesImage
              : ContourEnd::kClosed;
  m.area = a;
  if (!(a > 0)) return m;
  const double mx = ax / a, my = ay / a;
  // Corner (0, 0) is the point (base_x - 1/2, base_y - 1/2); a pixel's own
  // extent adds 1/12 to the variances.
  m.mean_x = base_x - 0.5 + mx;
  m.mean_y = base_y - 0.5 + my;
  m.var_xx = axx / a - mx * mx - 1.0 / 12.0;
  m.var_xy = axy / a - mx * my;
  m.var_yy = ayy / a - my * my - 1.0 / 12.0;
  return m;
}

}  // namespace videogrammetry
