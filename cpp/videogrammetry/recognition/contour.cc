#include "videogrammetry/recognition/contour.h"

#include <numbers>

namespace videogrammetry {

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

}  // namespace videogrammetry
