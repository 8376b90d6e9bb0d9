#include "videogrammetry/geometry/conic.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <numbers>

namespace videogrammetry {

Eigen::Matrix3d ConicFromEllipse(const Ellipse& ellipse) {
  const double c = std::cos(ellipse.angle_rad), s = std::sin(ellipse.angle_rad);
  Eigen::Matrix2d rotation;
  rotation << c, -s, s, c;
  const Eigen::Vector2d inverse_squares(1.0 / (ellipse.semi_major_px * ellipse.semi_major_px),
                                        1.0 / (ellipse.semi_minor_px * ellipse.semi_minor_px));
  const Eigen::Matrix2d shape = rotation * inverse_squares.asDiagonal() * rotation.transpose();
  const Eigen::Vector2d center(ellipse.x_px, ellipse.y_px);
  Eigen::Matrix3d conic;
  conic.topLeftCorner<2, 2>() = shape;
  conic.topRightCorner<2, 1>() = -shape * center;
  conic.bottomLeftCorner<1, 2>() = conic.topRightCorner<2, 1>().transpose();
  conic(2, 2) = center.dot(shape * center) - 1.0;
  return conic;
}

std::optional<Ellipse> EllipseFromConic(const Eigen::Matrix3d& conic) {
  if (!conic.allFinite()) return std::nullopt;
  const Eigen::Matrix2d shape = conic.topLeftCorner<2, 2>();
  const double determinant = shape.determinant();
  if (!(determinant > 1e-14 * shape.squaredNorm())) return std::nullopt;  // no ellipse
  const Eigen::Vector2d center = -shape.inverse() * conic.topRightCorner<2, 1>();
  // (x - c)^T S (x - c) = level
  const double level = center.dot(shape * center) - conic(2, 2);
  const Eigen::Matrix2d scaled = shape / level;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(scaled);
  const Eigen::Vector2d values = solver.eigenvalues();  // ascending: major axis first
  if (!(values[0] > 0) || !values.allFinite()) return std::nullopt;
  Ellipse ellipse;
  ellipse.x_px = center.x();
  ellipse.y_px = center.y();
  ellipse.semi_major_px = 1.0 / std::sqrt(values[0]);
  ellipse.semi_minor_px = 1.0 / std::sqrt(values[1]);
  const Eigen::Vector2d major = solver.eigenvectors().col(0);
  double angle = std::atan2(major.y(), major.x());
  if (angle < 0) angle += std::numbers::pi;
  if (angle >= std::numbers::pi) angle -= std::numbers::pi;
  ellipse.angle_rad = angle;
  return ellipse;
}

}  // namespace videogrammetry
