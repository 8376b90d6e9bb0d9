#include "videogrammetry/adjustment/p3p.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace videogrammetry {
namespace {

// Real roots, and the real parts of complex pairs close to the real axis.
std::vector<double> QuarticRoots(const double (&a)[5]) {
  Eigen::Matrix4d companion = Eigen::Matrix4d::Zero();
  for (int i = 0; i < 4; ++i) companion(i, 3) = -a[i] / a[4];
  companion.bottomLeftCorner<3, 3>().setIdentity();
  if (!companion.allFinite()) return {};
  const Eigen::EigenSolver<Eigen::Matrix4d> solver(companion, false);
  std::vector<double> roots;
  for (int i = 0; i < 4; ++i) {
    const auto root = solver.eigenvalues()[i];
    if (std::abs(root.imag()) > 0.2 * std::abs(root) || root.imag() < 0) continue;
    roots.push_back(root.real());
  }
  return roots;
}

}  // namespace

std::vector<Rigid3> SolveP3P(const Eigen::Matrix3d& points_mm, const Eigen::Matrix3d& rays) {
  const double a2 = (points_mm.col(1) - points_mm.col(2)).squaredNorm();
  const double b2 = (points_mm.col(0) - points_mm.col(2)).squaredNorm();
  const double c2 = (points_mm.col(0) - points_mm.col(1)).squaredNorm();
  const Eigen::Vector3d normal =
      (points_mm.col(1) - points_mm.col(0)).cross(points_mm.col(2) - points_mm.col(0));
  if (!(normal.squaredNorm() > 1e-8 * b2 * c2)) return {};
  const double ca = rays.col(1).dot(rays.col(2));
  const double cb = rays.col(0).dot(rays.col(2));
  const double cg = rays.col(0).dot(rays.col(1));
  const double q = (a2 - c2) / b2, s = (a2 + c2) / b2;
  const double c_b = c2 / b2, a_b = a2 / b2;
  const double coefficients[5] = {
      (1 + q) * (1 + q) - 4 * a_b * cg * cg,
      4 * (-q * (1 + q) * cb + 2 * a_b * cg * cg * cb - (1 - s) * ca * cg),
      2 * (q * q - 1 + 2 * q * q * cb * cb + 2 * (1 - c_b) * ca * ca - 4 * s * ca * cb * cg +
           2 * (1 - a_b) * cg * cg),
      4 * (q * (1 - q) * cb - (1 - s) * ca * cg + 2 * c_b * ca * ca * cb),
      (q - 1) * (q - 1) - 4 * c_b * ca * ca};
  std::vector<Rigid3> poses;
  for (const double v : QuarticRoots(coefficients)) {
    const double u = ((q - 1) * v * v - 2 * q * cb * v + 1 + q) / (2 * (cg - v * ca));
    const double s1_squared = b2 / (1 + v * v - 2 * v * cb);
    if (!(v > 0) || !(u > 0) || !(s1_squared > 0) || !std::isfinite(u)) continue;
    const double s1 = std::sqrt(s1_squared);
    const Eigen::Matrix3d in_cam = rays * Eigen::Vector3d(s1, u * s1, v * s1).asDiagonal();
    poses.push_back(FitRigid3(in_cam.transpose(), points_mm.transpose()));
  }
  return poses;
}

std::vector<Rigid3> SolveWeakPerspective(const Eigen::Matrix3d& points_mm,
                                         const Eigen::Matrix<double, 2, 3>& ideal_px, double f_px) {
  const double r01 = (points_mm.col(1) - points_mm.col(0)).squaredNorm();
  const double r02 = (points_mm.col(2) - points_mm.col(0)).squaredNorm();
  const double r12 = (points_mm.col(2) - points_mm.col(1)).squaredNorm();
  const double d01 = (ideal_px.col(1) - ideal_px.col(0)).squaredNorm();
  const double d02 = (ideal_px.col(2) - ideal_px.col(0)).squaredNorm();
  const double d12 = (ideal_px.col(2) - ideal_px.col(1)).squaredNorm();
  // 16 times the squared areas of the triangle and of its picture (Heron).
  auto heron = [](double a, double b, double c) {
    return 2 * (a * b + b * c + c * a) - (a * a + b * b + c * c);
  };
  const double a = heron(r01, r02, r12), c = heron(d01, d02, d12);
  const double b = d01 * (-r01 + r02 + r12) + d02 * (r01 - r02 + r12) + d12 * (r01 + r02 - r12);
  const double root = b * b - a * c;
  if (!(a > 1e-8 * r01 * r02) || !(b > 0) || !(root >= 0)) return {};
  const double scale2 = (b + std::sqrt(root)) / a, scale = std::sqrt(scale2);
  const double h1 = std::sqrt(std::max(0.0, scale2 * r01 - d01));
  double h2 = std::sqrt(std::max(0.0, scale2 * r02 - d02));
  if (d01 + d02 - d12 > scale2 * (r01 + r02 - r12)) h2 = -h2;
  std::vector<Rigid3> poses;
  for (const double sign : {1.0, -1.0}) {
    Eigen::Matrix3d in_cam;
    in_cam.topRows<2>() = ideal_px;
    in_cam.row(2) << f_px, f_px + sign * h1, f_px + sign * h2;
    in_cam /= scale;
    poses.push_back(FitRigid3(in_cam.transpose(), points_mm.transpose()));
  }
  return poses;
}

}  // namespace videogrammetry
