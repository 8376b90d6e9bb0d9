#include "videogrammetry/geometry/circle.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

namespace videogrammetry {
namespace {

/// Whether the whole circle lies before the camera: its picture is an ellipse.
bool IsBefore(const Circle& circle) {
  const double z = circle.center_mm.z();
  const double reach =
      circle.radius_mm * std::sqrt(std::max(0.0, 1.0 - circle.normal.z() * circle.normal.z()));
  return z > reach;
}

/// d^2 d_i / dp_j dp_k of the distortion polynomial, i the matrix, j and k its rows.
std::array<Eigen::Matrix2d, 2> DistortionCurvature(const Camera& camera,
                                                   const Eigen::Vector2d& point_px) {
  const auto& c = camera.interior;
  const double s = point_px.squaredNorm();
  const double first = c[kA1] + 2 * c[kA2] * s + 3 * c[kA3] * s * s;  // d radial / d r^2
  const double second = 2 * c[kA2] + 6 * c[kA3] * s;
  std::array<Eigen::Matrix2d, 2> curvature;
  for (int i = 0; i < 2; ++i) {
    Eigen::Matrix2d& h = curvature[i];
    h = (4 * second * point_px[i] * point_px) * point_px.transpose() +
        2 * first * point_px[i] * Eigen::Matrix2d::Identity();
    h.row(i) += 2 * first * point_px.transpose();
    h.col(i) += 2 * first * point_px;
  }
  const double b1 = 2 * c[kB1], b2 = 2 * c[kB2];
  curvature[0] += (Eigen::Matrix2d() << 3 * b1, b2, b2, b1).finished();
  curvature[1] += (Eigen::Matrix2d() << b2, b1, b1, 3 * b2).finished();
  return curvature;
}

}  // namespace

void Circle::Check(const char* what) const {
  const std::string name(what);
  if (!(radius_mm > 0) || !std::isfinite(radius_mm)) {
    throw std::invalid_argument(name + ": diameter must be positive and finite, got " +
                                std::to_string(2 * radius_mm) + " mm");
  }
  if (!normal.allFinite() || !(std::abs(normal.norm() - 1) < 1e-6)) {
    throw std::invalid_argument(name + ": normal must have unit length, got length " +
                                std::to_string(normal.norm()));
  }
  if (!center_mm.allFinite()) throw std::invalid_argument(name + ": centre is not finite");
}

Eigen::Vector2d DistortionShift(const Camera& camera, const Eigen::Vector2d& center_px,
                                const Eigen::Matrix2d& ideal_shape_px2) {
  if (camera.interior.segment<5>(kA1).isZero(0.0)) return Eigen::Vector2d::Zero();
  const bool measured = camera.direction == DistortionDirection::kMeasured;
  Eigen::Vector2d at = center_px - camera.principal_point_px();
  if (!measured) {
    const auto ideal = Undistort(camera, center_px);
    if (!ideal) return Eigen::Vector2d::Zero();
    at = *ideal;
  }
  Eigen::Matrix2d by_point;
  Distortion(camera, at, &by_point);
  const Eigen::Matrix2d slope = Eigen::Matrix2d::Identity() + by_point;
  // A of the ideal ellipse, B of the picture's: d picture / d ideal * A.
  const Eigen::Matrix2d ideal_axes = ideal_shape_px2.llt().matrixL();
  const Eigen::Matrix2d axes = measured ? Eigen::Matrix2d(slope.inverse() * ideal_axes)
                                        : Eigen::Matrix2d(slope * ideal_axes);
  const std::array<Eigen::Matrix2d, 2> curvature = DistortionCurvature(camera, at);
  // h in the frame of the unit circle. Measured direction: p + d(p) = q bends the
  // inverse, p'' = -p' d''[p', p'], and B^-1 p' = A^-1.
  const Eigen::Matrix2d& along = measured ? axes : ideal_axes;
  const Eigen::Matrix2d back =
      measured ? Eigen::Matrix2d(-ideal_axes.inverse()) : Eigen::Matrix2d(axes.inverse());
  const std::array<Eigen::Matrix2d, 2> raw = {along.transpose() * curvature[0] * along,
                                              along.transpose() * curvature[1] * along};
  const Eigen::Matrix2d hx = back(0, 0) * raw[0] + back(0, 1) * raw[1];
  const Eigen::Matrix2d hy = back(1, 0) * raw[0] + back(1, 1) * raw[1];
  const Eigen::Vector2d shift(3 * hx(0, 0) + hx(1, 1) + 2 * hy(0, 1),  // Eq. (3)
                              3 * hy(1, 1) + hy(0, 0) + 2 * hx(0, 1));
  return axes * shift / 8;
}

std::optional<Eigen::Vector2d> ProjectEllipseCenter(const Camera& camera, const Circle& circle,
                                                    EllipseCenterJacobians* jacobians) {
  if (!IsBefore(circle)) return std::nullopt;
  const Eigen::Vector3d& n = circle.normal;
  const double z = circle.center_mm.z(), q = circle.radius_mm * circle.radius_mm / z;
  const Eigen::Vector3d across = Eigen::Vector3d::UnitZ() - n.z() * n;
  const Eigen::Vector3d point = circle.center_mm - q * across;  // Eq. (2)
  ProjectionJacobians projection;
  const auto pixel = Project(camera, point, jacobians != nullptr ? &projection : nullptr);
  if (!pixel) return std::nullopt;
  if (jacobians != nullptr) {
    Eigen::Matrix3d by_center = Eigen::Matrix3d::Identity();
    by_center.col(2) += q / z * across;
    Eigen::Matrix3d by_normal = q * n.z() * Eigen::Matrix3d::Identity();
    by_normal.col(2) += q * n;
    jacobians->by_center = projection.by_point * by_center;
    jacobians->by_normal = projection.by_point * by_normal;
    jacobians->by_interior = projection.by_interior;
  }
  if (camera.interior.segment<5>(kA1).isZero(0.0)) return pixel;
  const auto shape = ProjectedShape(circle);
  if (!shape) return std::nullopt;
  Eigen::Matrix2d shape_px2;
  shape_px2 << (*shape)[0], (*shape)[1], (*shape)[1], (*shape)[2];
  shape_px2 *= camera.f_px() * camera.f_px();
  return Eigen::Vector2d(*pixel + DistortionShift(camera, *pixel, shape_px2));
}

std::optional<Eigen::Vector3d> ProjectedShape(const Circle& circle,
                                              Eigen::Matrix<double, 3, 4>* jacobian) {
  if (!IsBefore(circle)) return std::nullopt;
  const Eigen::Vector3d &c = circle.center_mm, &n = circle.normal;
  const double q = circle.radius_mm * circle.radius_mm;
  const Eigen::Matrix3d disc = q * (Eigen::Matrix3d::Identity() - n * n.transpose());
  const Eigen::Matrix3d dual = disc - c * c.transpose();  // Eq. (1)
  const double w = -dual(2, 2);
  const Eigen::Vector2d e = -dual.topRightCorner<2, 1>() / w;
  const Eigen::Vector2d p = c.head<2>() / c.z();
  // S = C*_2x2 / w + e e^T, where C*_2x2 holds -c c^T, which e e^T meets: written
  // in e - p and z^2 / w - 1, so that S keeps its digits.
  const Eigen::Vector2d off = (p * disc(2, 2) - disc.topRightCorner<2, 1>()) / w;
  const double lack = disc(2, 2) / w;  // z^2 / w - 1
  const Eigen::Matrix2d shape = disc.topLeftCorner<2, 2>() / w - lack * (p * p.transpose()) +
                                off * p.transpose() + p * off.transpose() + off * off.transpose();
  if (jacobian != nullptr) {
    for (int k = 0; k < 4; ++k) {
      Eigen::Matrix3d d;
      if (k < 3) {
        const Eigen::Vector3d axis = Eigen::Vector3d::Unit(k);
        d = -q * (axis * n.transpose() + n * axis.transpose());
      } else {
        d = 2 * disc;
      }
      const double dw = -d(2, 2);
      const Eigen::Vector2d de = -(d.topRightCorner<2, 1>() + dw * e) / w;
      const Eigen::Matrix2d ds = d.topLeftCorner<2, 2>() / w -
                                 dw / w * (shape - e * e.transpose()) + de * e.transpose() +
                                 e * de.transpose();
      jacobian->col(k) << ds(0, 0), ds(0, 1), ds(1, 1);
    }
  }
  return Eigen::Vector3d(shape(0, 0), shape(0, 1), shape(1, 1));
}

}  // namespace videogrammetry
