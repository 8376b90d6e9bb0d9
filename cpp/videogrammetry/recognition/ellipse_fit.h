#pragma once

#include <Eigen/Core>
#include <optional>

#include "videogrammetry/geometry/conic.h"
#include "videogrammetry/recognition/edge_points.h"

namespace videogrammetry {

/// Fits an ellipse to edge points by direct least squares.
///
/// Minimises the summed squared algebraic distance under 4ac - b^2 = 1: the
/// 3x3 eigenproblem of [1], Eqs. (28)-(29), on centred and scaled points. The
/// algebraic distance prefers small ellipses: a start value only.
///
/// @param edge_points_px  (N, 2), N >= 5: x, y in pixels.
/// @return nullopt if the points determine no ellipse (coincident, collinear).
/// @throws std::invalid_argument if N < 5 or a coordinate is not finite.
///
/// [1] R. Halir, J. Flusser, Numerically stable direct least squares fitting
///     of ellipses, WSCG 1998.
std::optional<Ellipse> FitEllipse(const Eigen::Ref<const Points2d>& edge_points_px);

/// The same with points that belong to something else left out: those further
/// than three robust standard deviations (and 0.3 px) from the ellipse, until
/// nothing changes.
///
/// @param inliers  receives 1 for each point kept, 0 for each left out.
std::optional<Ellipse> FitEllipseRobust(const Eigen::Ref<const Points2d>& edge_points_px,
                                        Eigen::ArrayXi* inliers);

/// Distances of points from an ellipse to first order (Sampson), positive outside.
Eigen::ArrayXd EllipseDistances(const Ellipse& ellipse,
                                const Eigen::Ref<const Points2d>& points_px);

/// An ellipse as x(u) = c + E u, |u| = 1, with E symmetric positive definite:
/// regular for circles too, where the axes' direction is undefined.
///
/// E = R diag(a, b) R^T. At u the outward normal is n = E^-1 u / |E^-1 u|; a
/// change of the five parameters moves the ellipse along it by
/// n . dc + n^T dE u, linear in (c_x, c_y, E_xx, E_xy, E_yy).
struct EllipseFrame {
  Eigen::Vector2d center = Eigen::Vector2d::Zero();
  Eigen::Matrix2d shape = Eigen::Matrix2d::Identity();

  static EllipseFrame From(const Ellipse& ellipse);
  Eigen::Vector2d Point(const Eigen::Vector2d& u) const { return center + shape * u; }
  Eigen::Vector2d Normal(const Eigen::Vector2d& u) const;
  /// Derivative of the displacement along the normal.
  Eigen::Matrix<double, 1, 5> NormalJacobian(const Eigen::Vector2d& u) const;
  /// nullopt if the shape is not positive definite any more.
  std::optional<EllipseFrame> Moved(const Eigen::Matrix<double, 5, 1>& step) const;
  Ellipse ToEllipse() const;
  /// Derivative of (x, y, a, b, angle) by the five parameters. For a circle
  /// the angle has none: |a - b| is held at 1e-6 px or more.
  Eigen::Matrix<double, 5, 5> EllipseJacobian() const;
};

/// Takes the direction's sigma of a covariance of (x, y, a, b, angle) back to what it is
/// where nothing is known of it, pi / sqrt(12).
void BoundDirection(Eigen::Matrix<double, 5, 5>* cov);

}  // namespace videogrammetry
