#include "videogrammetry/recognition/ellipse_fit.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

namespace videogrammetry {
namespace {

/// Scatter matrices of [1], Eq. (16), of centred and scaled points.
struct Scatter {
  Eigen::Matrix3d quadratic = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d mixed = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d linear = Eigen::Matrix3d::Zero();
};

/// [1], Eqs. (28)-(29): coefficients (a, b, c, d, e, f) of the conic.
std::optional<Eigen::Matrix<double, 6, 1>> SolveDirect(const Scatter& s) {
  const Eigen::FullPivLU<Eigen::Matrix3d> linear(s.linear);
  if (!linear.isInvertible()) return std::nullopt;
  const Eigen::Matrix3d t = -linear.solve(s.mixed.transpose());
  const Eigen::Matrix3d m = s.quadratic + s.mixed * t;
  Eigen::Matrix3d reduced;  // C1^-1 M, C1 = (0 0 2; 0 -1 0; 2 0 0)
  reduced.row(0) = 0.5 * m.row(2);
  reduced.row(1) = -m.row(1);
  reduced.row(2) = 0.5 * m.row(0);
  const Eigen::EigenSolver<Eigen::Matrix3d> solver(reduced);
  if (solver.info() != Eigen::Success) return std::nullopt;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d v = solver.eigenvectors().col(i).real();
    if (4.0 * v[0] * v[2] - v[1] * v[1] > 0.0) {
      Eigen::Matrix<double, 6, 1> conic;
      conic << v, t * v;
      return conic;
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<Ellipse> FitEllipse(const Eigen::Ref<const Points2d>& points) {
  if (points.rows() < 5) {
    throw std::invalid_argument("edge_points_px: expected at least 5 points, got " +
                                std::to_string(points.rows()));
  }
  if (!points.allFinite()) {
    throw std::invalid_argument("edge_points_px: a coordinate is not finite");
  }
  const Eigen::RowVector2d mean = points.colwise().mean();
  const double scale =
      std::sqrt((points.rowwise() - mean).squaredNorm() / static_cast<double>(points.rows()));
  if (!(scale > 1e-9)) return std::nullopt;
  Scatter scatter;
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    const double x = (points(i, 0) - mean[0]) / scale, y = (points(i, 1) - mean[1]) / scale;
    const Eigen::Vector3d q(x * x, x * y, y * y), l(x, y, 1.0);
    scatter.quadratic += q * q.transpose();
    scatter.mixed += q * l.transpose();
    scatter.linear += l * l.transpose();
  }
  const auto c = SolveDirect(scatter);
  if (!c) return std::nullopt;
  const auto& p = *c;
  Eigen::Matrix3d conic;
  conic << p[0], 0.5 * p[1], 0.5 * p[3], 0.5 * p[1], p[2], 0.5 * p[4], 0.5 * p[3], 0.5 * p[4], p[5];
  auto ellipse = EllipseFromConic(conic);
  if (!ellipse) return std::nullopt;
  ellipse->x_px = mean[0] + scale * ellipse->x_px;
  ellipse->y_px = mean[1] + scale * ellipse->y_px;
  ellipse->semi_major_px *= scale;
  ellipse->semi_minor_px *= scale;
  return ellipse;
}

Eigen::ArrayXd EllipseDistances(const Ellipse& ellipse, const Eigen::Ref<const Points2d>& points) {
  const Eigen::Matrix3d conic = ConicFromEllipse(ellipse);
  Eigen::ArrayXd distances(points.rows());
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    const Eigen::Vector3d p(points(i, 0), points(i, 1), 1.0);
    const Eigen::Vector3d gradient = conic * p;
    distances[i] = 0.5 * p.dot(gradient) / std::max(1e-12, gradient.head<2>().norm());
  }
  return distances;
}

std::optional<Ellipse> FitEllipseRobust(const Eigen::Ref<const Points2d>& points,
                                        Eigen::ArrayXi* inliers) {
  constexpr int kMaxRounds = 5;
  constexpr double kLeastLimit = 0.3;
  *inliers = Eigen::ArrayXi::Ones(points.rows());
  std::optional<Ellipse> ellipse;
  Points2d kept = points;
  for (int round = 0; round < kMaxRounds; ++round) {
    if (kept.rows() < 6) return std::nullopt;
    ellipse = FitEllipse(kept);
    if (!ellipse) return std::nullopt;
    const Eigen::ArrayXd distances = EllipseDistances(*ellipse, points).abs();
    std::vector<double> sorted(distances.begin(), distances.end());
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const double limit = std::max(kLeastLimit, 3.0 * 1.4826 * *middle);
    const Eigen::ArrayXi now = (distances <= limit).cast<int>();
    if ((now == *inliers).all()) break;
    *inliers = now;
    kept.resize(now.sum(), 2);
    for (Eigen::Index i = 0, k = 0; i < points.rows(); ++i) {
      if (now[i] != 0) kept.row(k++) = points.row(i);
    }
  }
  return ellipse;
}

EllipseFrame EllipseFrame::From(const Ellipse& e) {
  EllipseFrame frame;
  frame.center = {e.x_px, e.y_px};
  const double c = std::cos(e.angle_rad), s = std::sin(e.angle_rad);
  const double a = e.semi_major_px, b = e.semi_minor_px;
  frame.shape << a * c * c + b * s * s, (a - b) * c * s, (a - b) * c * s, a * s * s + b * c * c;
  return frame;
}

Eigen::Vector2d EllipseFrame::Normal(const Eigen::Vector2d& u) const {
  // E^-1 u up to a positive factor, by the adjoint of a symmetric 2x2 matrix.
  const Eigen::Vector2d n(shape(1, 1) * u.x() - shape(0, 1) * u.y(),
                          -shape(0, 1) * u.x() + shape(0, 0) * u.y());
  return n.normalized();
}

Eigen::Matrix<double, 1, 5> EllipseFrame::NormalJacobian(const Eigen::Vector2d& u) const {
  const Eigen::Vector2d n = Normal(u);
  Eigen::Matrix<double, 1, 5> jacobian;
  jacobian << n.x(), n.y(), n.x() * u.x(), n.x() * u.y() + n.y() * u.x(), n.y() * u.y();
  return jacobian;
}

std::optional<EllipseFrame> EllipseFrame::Moved(const Eigen::Matrix<double, 5, 1>& step) const {
  EllipseFrame moved = *this;
  moved.center += step.head<2>();
  moved.shape(0, 0) += step[2];
  moved.shape(0, 1) += step[3];
  moved.shape(1, 0) += step[3];
  moved.shape(1, 1) += step[4];
  if (!moved.shape.allFinite() || !moved.center.allFinite()) return std::nullopt;
  if (!(moved.shape(0, 0) > 0) || !(moved.shape.determinant() > 0)) return std::nullopt;
  return moved;
}

Ellipse EllipseFrame::ToEllipse() const {
  const double half_trace = 0.5 * (shape(0, 0) + shape(1, 1));
  const double half_difference = 0.5 * (shape(0, 0) - shape(1, 1));
  const double root = std::hypot(half_difference, shape(0, 1));
  double angle = 0.5 * std::atan2(shape(0, 1), half_difference);
  if (angle < 0) angle += std::numbers::pi;
  if (angle >= std::numbers::pi) angle = 0.0;
  return {center.x(), center.y(), half_trace + root, half_trace - root, angle};
}

Eigen::Matrix<double, 5, 5> EllipseFrame::EllipseJacobian() const {
  const Ellipse e = ToEllipse();
  const double c = std::cos(e.angle_rad), s = std::sin(e.angle_rad);
  const double difference = std::max(1e-6, e.semi_major_px - e.semi_minor_px);
  Eigen::Matrix<double, 5, 5> jacobian = Eigen::Matrix<double, 5, 5>::Zero();
  jacobian(0, 0) = jacobian(1, 1) = 1.0;
  // da = m' dE m, db = k' dE k, dangle = k' dE m / (a - b); m, k: the axes' directions.
  jacobian.block<1, 3>(2, 2) << c * c, 2 * c * s, s * s;
  jacobian.block<1, 3>(3, 2) << s * s, -2 * c * s, c * c;
  jacobian.block<1, 3>(4, 2) << -c * s / difference, (c * c - s * s) / difference,
      c * s / difference;
  return jacobian;
}

void BoundDirection(Eigen::Matrix<double, 5, 5>* cov) {
  const double most = std::numbers::pi / std::sqrt(12.0);
  const double sigma = std::sqrt((*cov)(4, 4));
  if (sigma <= most) return;
  cov->row(4) *= most / sigma;
  cov->col(4) *= most / sigma;
}

}  // namespace videogrammetry
