#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace videogrammetry {

/// Rotation vector (axis times angle, rad) to matrix: Rodrigues' formula.
Eigen::Matrix3d RotationFromVector(const Eigen::Vector3d& rotation_rad);

/// Matrix to rotation vector, angle in [0, pi].
Eigen::Vector3d VectorFromRotation(const Eigen::Matrix3d& rotation);

/// The rotation nearest to `matrix` in the Frobenius norm (orthogonal
/// Procrustes, SVD with the determinant's sign put into the last singular
/// vector): what Eq. (8)'s mean of matrix elements needs.
Eigen::Matrix3d NearestRotation(const Eigen::Matrix3d& matrix);

/// A rigid motion: x_in_a = rotation * x_in_b + translation_mm for an object
/// named a_from_b.
struct Rigid3 {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation_mm = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& point_mm) const {
    return rotation * point_mm + translation_mm;
  }
  /// a_from_c = a_from_b * b_from_c.
  Rigid3 operator*(const Rigid3& other) const {
    return {rotation * other.rotation, rotation * other.translation_mm + translation_mm};
  }
  Rigid3 Inverse() const {
    return {rotation.transpose(), -(rotation.transpose() * translation_mm)};
  }
};

/// Best-fit rigid motion a_from_b of corresponding points, (N, 3) each, N >= 3:
/// least squares over rotation and translation only (Kabsch; Umeyama, IEEE
/// PAMI 13 (1991), without scale).
/// @throws std::invalid_argument if the sizes differ or N < 3.
Rigid3 FitRigid3(const Eigen::Ref<const Eigen::Matrix<double, Eigen::Dynamic, 3>>& points_in_a,
                 const Eigen::Ref<const Eigen::Matrix<double, Eigen::Dynamic, 3>>& points_in_b);

}  // namespace videogrammetry
