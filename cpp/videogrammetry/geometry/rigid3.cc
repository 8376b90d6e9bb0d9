#include "videogrammetry/geometry/rigid3.h"

#include <Eigen/SVD>
#include <stdexcept>
#include <string>

namespace videogrammetry {

Eigen::Matrix3d RotationFromVector(const Eigen::Vector3d& rotation_rad) {
  const double angle = rotation_rad.norm();
  Eigen::Matrix3d cross;
  cross << 0, -rotation_rad.z(), rotation_rad.y(), rotation_rad.z(), 0, -rotation_rad.x(),
      -rotation_rad.y(), rotation_rad.x(), 0;
  // Series below 1e-4 rad, where (1 - cos) would lose its digits.
  const double a = angle < 1e-4 ? 1.0 - angle * angle / 6.0 : std::sin(angle) / angle;
  const double half = std::sin(0.5 * angle);
  const double b = angle < 1e-4 ? 0.5 - angle * angle / 24.0 : 2.0 * half * half / (angle * angle);
  return Eigen::Matrix3d::Identity() + a * cross + b * cross * cross;
}

Eigen::Vector3d VectorFromRotation(const Eigen::Matrix3d& rotation) {
  // Through the quaternion: exact near 0 and near pi alike.
  Eigen::Quaterniond q(rotation);
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const double sine = q.vec().norm();
  if (sine < 1e-12) return 2.0 * q.vec();
  return q.vec() * (2.0 * std::atan2(sine, q.w()) / sine);
}

Eigen::Matrix3d NearestRotation(const Eigen::Matrix3d& matrix) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant());
  return svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
}

Rigid3 FitRigid3(const Eigen::Ref<const Eigen::Matrix<double, Eigen::Dynamic, 3>>& points_in_a,
                 const Eigen::Ref<const Eigen::Matrix<double, Eigen::Dynamic, 3>>& points_in_b) {
  if (points_in_a.rows() != points_in_b.rows() || points_in_a.rows() < 3) {
    throw std::invalid_argument("FitRigid3: needs at least 3 pairs of points, got " +
                                std::to_string(points_in_a.rows()) + " and " +
                                std::to_string(points_in_b.rows()));
  }
  const Eigen::RowVector3d mean_a = points_in_a.colwise().mean();
  const Eigen::RowVector3d mean_b = points_in_b.colwise().mean();
  const Eigen::Matrix3d moment =
      (points_in_a.rowwise() - mean_a).transpose() * (points_in_b.rowwise() - mean_b);
  Rigid3 a_from_b;
  a_from_b.rotation = NearestRotation(moment);
  a_from_b.translation_mm = mean_a.transpose() - a_from_b.rotation * mean_b.transpose();
  return a_from_b;
}

}  // namespace videogrammetry
