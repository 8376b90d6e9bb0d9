#include "videogrammetry/adjustment/homography.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <stdexcept>
#include <string>

namespace videogrammetry {
namespace {

Eigen::Matrix3d Normaliser(const Eigen::Ref<const Points2d>& points) {
  const Eigen::RowVector2d mean = points.colwise().mean();
  const double spread = std::sqrt((points.rowwise() - mean).rowwise().squaredNorm().mean() / 2);
  const double s = spread > 0 ? 1.0 / spread : 1.0;
  Eigen::Matrix3d t;
  t << s, 0, -s * mean.x(), 0, s, -s * mean.y(), 0, 0, 1;
  return t;
}

}  // namespace

std::optional<Eigen::Matrix3d> FitHomography(const Eigen::Ref<const Points2d>& plane_mm,
                                             const Eigen::Ref<const Points2d>& pixels) {
  if (plane_mm.rows() != pixels.rows() || plane_mm.rows() < 4) {
    throw std::invalid_argument("FitHomography: needs at least 4 pairs of points, got " +
                                std::to_string(plane_mm.rows()) + " and " +
                                std::to_string(pixels.rows()));
  }
  const Eigen::Matrix3d t1 = Normaliser(plane_mm), t2 = Normaliser(pixels);
  Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
  for (Eigen::Index i = 0; i < plane_mm.rows(); ++i) {
    const Eigen::Vector3d x = t1 * plane_mm.row(i).transpose().homogeneous();
    const Eigen::Vector3d u = t2 * pixels.row(i).transpose().homogeneous();
    Eigen::Matrix<double, 2, 9> a;
    a << x.transpose(), Eigen::RowVector3d::Zero(), -u.x() * x.transpose(),
        Eigen::RowVector3d::Zero(), x.transpose(), -u.y() * x.transpose();
    normal += a.transpose() * a;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> eigen(normal);
  if (!(eigen.eigenvalues()[1] > 1e-10 * eigen.eigenvalues()[8])) return std::nullopt;
  const Eigen::Matrix<double, 9, 1> h = eigen.eigenvectors().col(0);
  Eigen::Matrix3d homography;
  homography << h.segment<3>(0).transpose(), h.segment<3>(3).transpose(),
      h.segment<3>(6).transpose();
  return Eigen::Matrix3d(t2.inverse() * homography * t1);
}

Rigid3 PoseFromHomography(const Eigen::Matrix3d& homography, double f_px) {
  const Eigen::Matrix3d m = Eigen::Vector3d(1 / f_px, 1 / f_px, 1).asDiagonal() * homography;
  double scale = 2.0 / (m.col(0).norm() + m.col(1).norm());
  if (m(2, 2) < 0) scale = -scale;  // the plane's origin lies in front
  Eigen::Matrix3d r;
  r.col(0) = scale * m.col(0);
  r.col(1) = scale * m.col(1);
  r.col(2) = r.col(0).cross(r.col(1));
  return {NearestRotation(r), scale * m.col(2)};
}

Rigid3 FlippedPose(const Rigid3& cam_from_object, const Eigen::Vector3d& centre_mm,
                   const Eigen::Vector3d& plane_normal) {
  const Eigen::Vector3d centre_in_cam = cam_from_object * centre_mm;
  const Eigen::Vector3d d = centre_in_cam.normalized();
  const Eigen::Matrix3d in_depth = Eigen::Matrix3d::Identity() - 2 * d * d.transpose();
  const Eigen::Matrix3d at_plane =
      Eigen::Matrix3d::Identity() - 2 * plane_normal * plane_normal.transpose();
  Rigid3 flipped;
  flipped.rotation = in_depth * cam_from_object.rotation * at_plane;
  flipped.translation_mm = centre_in_cam - flipped.rotation * centre_mm;
  return flipped;
}

std::optional<double> FocalFromHomographies(const std::vector<Eigen::Matrix3d>& homographies) {
  double aa = 0.0, ab = 0.0, strength = 0.0;
  for (const Eigen::Matrix3d& raw : homographies) {
    const Eigen::Matrix3d h = raw / raw.col(0).norm();
    const Eigen::Vector3d h1 = h.col(0), h2 = h.col(1);
    // a / f^2 + b = 0 for each of the two conditions.
    const double a1 = h1.head<2>().dot(h2.head<2>()), b1 = h1.z() * h2.z();
    const double a2 = h1.head<2>().squaredNorm() - h2.head<2>().squaredNorm();
    const double b2 = h1.z() * h1.z() - h2.z() * h2.z();
    aa += a1 * a1 + a2 * a2;
    ab += a1 * b1 + a2 * b2;
    strength += h1.head<2>().squaredNorm() * h2.head<2>().squaredNorm();
  }
  if (!(aa > 1e-6 * strength)) return std::nullopt;
  const double inverse_square = -ab / aa;
  if (!(inverse_square > 0)) return std::nullopt;
  return 1.0 / std::sqrt(inverse_square);
}

}  // namespace videogrammetry
