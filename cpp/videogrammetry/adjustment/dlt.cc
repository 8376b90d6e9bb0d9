#include "videogrammetry/adjustment/dlt.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>

#include "videogrammetry/core/errors.h"

namespace videogrammetry {
namespace {

/// Similarity that takes points to mean 0 and mean squared radius N (their dimension).
template <int N>
Eigen::Matrix<double, N + 1, N + 1> Normaliser(
    const Eigen::Ref<const Eigen::Matrix<double, Eigen::Dynamic, N>>& points) {
  const Eigen::Matrix<double, 1, N> mean = points.colwise().mean();
  const double spread = std::sqrt((points.rowwise() - mean).rowwise().squaredNorm().mean() / N);
  const double scale = spread > 0 ? 1.0 / spread : 1.0;
  Eigen::Matrix<double, N + 1, N + 1> t = Eigen::Matrix<double, N + 1, N + 1>::Identity();
  t.template topLeftCorner<N, N>() *= scale;
  t.template topRightCorner<N, 1>() = -scale * mean.transpose();
  return t;
}

/// K and R of M = K R: RQ decomposition by QR of the row-reversed matrix.
void DecomposeRq(const Eigen::Matrix3d& m, Eigen::Matrix3d* k, Eigen::Matrix3d* r) {
  const Eigen::Matrix3d flip =
      Eigen::Vector3d::Ones().asDiagonal().toDenseMatrix().rowwise().reverse();
  const Eigen::HouseholderQR<Eigen::Matrix3d> qr((flip * m).transpose());
  const Eigen::Matrix3d q = qr.householderQ();
  Eigen::Matrix3d upper = qr.matrixQR().triangularView<Eigen::Upper>();
  *k = flip * upper.transpose() * flip;
  *r = flip * q.transpose();
  const Eigen::Vector3d sign = k->diagonal().array().sign();
  *k = *k * sign.asDiagonal();
  *r = sign.asDiagonal() * *r;
}

Eigen::Matrix<double, 3, 4> SolveProjection(const Eigen::Ref<const Points3d>& points,
                                            const Eigen::Ref<const Points2d>& pixels) {
  const Eigen::Matrix4d t3 = Normaliser<3>(points);
  const Eigen::Matrix3d t2 = Normaliser<2>(pixels);
  Eigen::Matrix<double, 12, 12> normal = Eigen::Matrix<double, 12, 12>::Zero();
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    const Eigen::Vector4d x = t3 * points.row(i).transpose().homogeneous();
    const Eigen::Vector3d u = t2 * pixels.row(i).transpose().homogeneous();
    Eigen::Matrix<double, 2, 12> a = Eigen::Matrix<double, 2, 12>::Zero();
    a.block<1, 4>(0, 0) = x.transpose();
    a.block<1, 4>(0, 8) = -u.x() * x.transpose();
    a.block<1, 4>(1, 4) = x.transpose();
    a.block<1, 4>(1, 8) = -u.y() * x.transpose();
    normal += a.transpose() * a;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 12, 12>> eigen(normal);
  const auto& values = eigen.eigenvalues();
  if (!(values[1] > 1e-10 * values[11])) {
    throw AdjustmentError(
        "DLT: the points have no unique projective camera (coplanar, or on a critical curve); "
        "start from a plane or give a start value for f");
  }
  const Eigen::Matrix<double, 12, 1> p = eigen.eigenvectors().col(0);
  Eigen::Matrix<double, 3, 4> projection;
  projection << p.segment<4>(0).transpose(), p.segment<4>(4).transpose(),
      p.segment<4>(8).transpose();
  return t2.inverse() * projection * t3;
}

}  // namespace

Eigen::Vector3d PrincipalExtents(const Eigen::Ref<const Points3d>& points_mm,
                                 Eigen::Matrix3d* axes) {
  const Eigen::RowVector3d mean = points_mm.colwise().mean();
  const Points3d centred = points_mm.rowwise() - mean;
  const Eigen::JacobiSVD<Points3d> svd(centred, Eigen::ComputeThinV);
  if (axes != nullptr) *axes = svd.matrixV();
  const Eigen::Vector3d s = svd.singularValues();
  return s[0] > 0 ? Eigen::Vector3d(s / s[0]) : Eigen::Vector3d::Zero();
}

DltResult DirectLinearTransform(const Eigen::Ref<const Points3d>& points_mm,
                                const Eigen::Ref<const Points2d>& pixels) {
  if (points_mm.rows() != pixels.rows() || points_mm.rows() < 6) {
    throw std::invalid_argument("DLT: needs at least 6 points with a picture each, got " +
                                std::to_string(points_mm.rows()) + " points and " +
                                std::to_string(pixels.rows()) + " pictures");
  }
  const double thickness = PrincipalExtents(points_mm)[2];
  if (thickness < 1e-3) {
    std::ostringstream what;
    what << "DLT: the " << points_mm.rows() << " points are coplanar (out of plane by " << thickness
         << " of their extent); it needs a target that is not flat";
    throw AdjustmentError(what.str());
  }
  Eigen::Matrix<double, 3, 4> p = SolveProjection(points_mm, pixels);
  // The sign that puts the first point in front: row 3 of R is a unit vector.
  const double depth = p.row(2) * points_mm.row(0).transpose().homogeneous();
  if (depth < 0) p = -p;
  const Eigen::Matrix3d m = p.leftCols<3>();
  if (!(m.determinant() > 0)) {
    throw AdjustmentError(
        "DLT: the solution is mirrored: the target's coordinates or the picture are left-handed");
  }
  DltResult result;
  DecomposeRq(m, &result.calibration, &result.cam_from_object.rotation);
  result.cam_from_object.translation_mm = result.calibration.inverse() * p.col(3);
  result.calibration /= result.calibration(2, 2);
  double squares = 0.0;
  for (Eigen::Index i = 0; i < points_mm.rows(); ++i) {
    const Eigen::Vector3d u = p * points_mm.row(i).transpose().homogeneous();
    if (!(u.z() > 0)) throw AdjustmentError("DLT: points lie behind the camera");
    squares += (u.hnormalized() - pixels.row(i).transpose()).squaredNorm();
  }
  result.rms_px = std::sqrt(squares / (2.0 * static_cast<double>(points_mm.rows())));
  return result;
}

}  // namespace videogrammetry
