#include "videogrammetry/adjustment/five_point.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <array>
#include <cmath>

namespace videogrammetry {
namespace {

// Exponents of x, y, z; the cubic ones first, then the quotient ring's basis,
// whose last four are also the monomials of a linear polynomial.
constexpr int kMonomials = 20, kBasis = 10, kLinear = 4;
constexpr std::array<std::array<int, 3>, kMonomials> kExponents = {
    {{3, 0, 0}, {2, 1, 0}, {2, 0, 1}, {1, 2, 0}, {1, 1, 1}, {1, 0, 2}, {0, 3, 0},
     {0, 2, 1}, {0, 1, 2}, {0, 0, 3}, {2, 0, 0}, {1, 1, 0}, {1, 0, 1}, {0, 2, 0},
     {0, 1, 1}, {0, 0, 2}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}}};
constexpr int kFirstBasis = kMonomials - kBasis, kFirstLinear = kMonomials - kLinear;

using Linear = Eigen::Matrix<double, 1, kLinear>;
using Quadratic = Eigen::Matrix<double, 1, kBasis>;
using Cubic = Eigen::Matrix<double, 1, kMonomials>;

constexpr int IndexOf(int x, int y, int z) {
  for (int i = 0; i < kMonomials; ++i) {
    if (kExponents[i][0] == x && kExponents[i][1] == y && kExponents[i][2] == z) return i;
  }
  return -1;
}

/// Place of the product of monomial `first + i` and linear monomial j.
template <int Count>
constexpr std::array<std::array<int, kLinear>, Count> Products(int first) {
  std::array<std::array<int, kLinear>, Count> table{};
  for (int i = 0; i < Count; ++i) {
    for (int j = 0; j < kLinear; ++j) {
      const auto& a = kExponents[first + i];
      const auto& b = kExponents[kFirstLinear + j];
      table[i][j] = IndexOf(a[0] + b[0], a[1] + b[1], a[2] + b[2]);
    }
  }
  return table;
}

constexpr auto kLinearLinear = Products<kLinear>(kFirstLinear);
constexpr auto kQuadraticLinear = Products<kBasis>(kFirstBasis);

Quadratic Multiply(const Linear& a, const Linear& b) {
  Quadratic product = Quadratic::Zero();
  for (int i = 0; i < kLinear; ++i) {
    for (int j = 0; j < kLinear; ++j) product[kLinearLinear[i][j] - kFirstBasis] += a[i] * b[j];
  }
  return product;
}

Cubic Multiply(const Quadratic& a, const Linear& b) {
  Cubic product = Cubic::Zero();
  for (int i = 0; i < kBasis; ++i) {
    for (int j = 0; j < kLinear; ++j) product[kQuadraticLinear[i][j]] += a[i] * b[j];
  }
  return product;
}

using LinearMatrix = std::array<std::array<Linear, 3>, 3>;

/// The ten cubic equations, one a row: det E = 0, 2 E E'E - tr(E E') E = 0.
Eigen::Matrix<double, 10, kMonomials> Equations(const LinearMatrix& e) {
  Eigen::Matrix<double, 10, kMonomials> equations;
  auto minor = [&](int c0, int c1) -> Quadratic {
    return Multiply(e[1][c0], e[2][c1]) - Multiply(e[1][c1], e[2][c0]);
  };
  equations.row(0) = Multiply(minor(1, 2), e[0][0]) - Multiply(minor(0, 2), e[0][1]) +
                     Multiply(minor(0, 1), e[0][2]);
  std::array<std::array<Quadratic, 3>, 3> eet;
  Quadratic trace = Quadratic::Zero();
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      eet[i][j].setZero();
      for (int k = 0; k < 3; ++k) eet[i][j] += Multiply(e[i][k], e[j][k]);
    }
    trace += eet[i][i];
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      Cubic sum = -Multiply(trace, e[i][j]);
      for (int k = 0; k < 3; ++k) sum += 2 * Multiply(eet[i][k], e[k][j]);
      equations.row(1 + 3 * i + j) = sum;
    }
  }
  return equations;
}

}  // namespace

std::vector<Eigen::Matrix3d> EssentialFromFive(const Eigen::Matrix<double, 3, 5>& rays_a,
                                               const Eigen::Matrix<double, 3, 5>& rays_b) {
  Eigen::Matrix<double, 9, 5> design;  // a column an equation, E row by row
  for (int k = 0; k < 5; ++k) {
    const Eigen::Vector3d a = rays_a.col(k).normalized(), b = rays_b.col(k).normalized();
    design.col(k) << b.x() * a, b.y() * a, b.z() * a;
  }
  const Eigen::Matrix<double, 9, 9> q =
      Eigen::HouseholderQR<Eigen::Matrix<double, 9, 5>>(design).householderQ();
  const Eigen::Matrix<double, 9, 4> null_space = q.rightCols<4>();
  LinearMatrix e;
  for (int i = 0; i < 9; ++i) e[i / 3][i % 3] = null_space.row(i);
  const Eigen::Matrix<double, 10, kMonomials> equations = Equations(e);
  const Eigen::Matrix<double, 10, 10> reduced =
      equations.leftCols<10>().partialPivLu().solve(equations.rightCols<10>());
  if (!reduced.allFinite()) return {};
  // x times the basis (x^2, xy, xz, y^2, yz, z^2, x, y, z, 1): the first six are
  // cubic and replaced by the basis, the others are in it.
  Eigen::Matrix<double, 10, 10> action = Eigen::Matrix<double, 10, 10>::Zero();
  action.topRows<6>() = -reduced.topRows<6>();
  action(6, 0) = action(7, 1) = action(8, 2) = action(9, 6) = 1;
  const Eigen::EigenSolver<Eigen::Matrix<double, 10, 10>> solver(action);
  if (solver.info() != Eigen::Success) return {};
  std::vector<Eigen::Matrix3d> solutions;
  for (int i = 0; i < 10; ++i) {
    const auto value = solver.eigenvalues()[i];
    if (std::abs(value.imag()) > 1e-8 * (1 + std::abs(value))) continue;
    const Eigen::Vector4d v = solver.eigenvectors().col(i).tail<4>().real();
    const Eigen::Matrix<double, 9, 1> flat = (null_space * v).normalized();
    if (!flat.allFinite()) continue;
    Eigen::Matrix3d essential;
    for (int k = 0; k < 9; ++k) essential(k / 3, k % 3) = flat[k];
    solutions.push_back(essential);
  }
  return solutions;
}

std::vector<Rigid3> PosesFromEssential(const Eigen::Matrix3d& essential) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(essential, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d u = svd.matrixU(), v = svd.matrixV();
  if (u.determinant() < 0) u.col(2) *= -1;
  if (v.determinant() < 0) v.col(2) *= -1;
  Eigen::Matrix3d w;
  w << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  const Eigen::Vector3d t = u.col(2);
  std::vector<Rigid3> poses;
  for (const Eigen::Matrix3d& turn : {w, Eigen::Matrix3d(w.transpose())}) {
    const Eigen::Matrix3d rotation = u * turn * v.transpose();
    poses.push_back({rotation, t});
    poses.push_back({rotation, -t});
  }
  return poses;
}

std::vector<Rigid3> PosesFromPlane(const Eigen::Matrix3d& homography,
                                   const Eigen::Ref<const Eigen::MatrixX3d>& rays_a,
                                   const Eigen::Ref<const Eigen::MatrixX3d>& rays_b) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(homography, Eigen::ComputeFullV);
  Eigen::Vector3d s = svd.singularValues();
  if (!(s[2] > 1e-9 * s[0])) return {};
  Eigen::Matrix3d h = homography / s[1];
  s /= s[1];
  // Its sign: points before camera a lie before camera b.
  const double sign = ((rays_a * h.transpose()).array() * rays_b.array()).sum();
  if (sign < 0) h = -h;
  const Eigen::Vector3d square = s.cwiseAbs2();
  if (!(square[0] - square[2] > 1e-12)) return {};
  const Eigen::Vector3d v1 = svd.matrixV().col(0), v2 = svd.matrixV().col(1);
  const Eigen::Vector3d v3 = svd.matrixV().col(2);
  const double along1 = std::sqrt(std::max(0.0, 1 - square[2]) / (square[0] - square[2]));
  const double along3 = std::sqrt(std::max(0.0, square[0] - 1) / (square[0] - square[2]));
  std::vector<Rigid3> poses;
  for (const double side : {1.0, -1.0}) {
    const Eigen::Vector3d u = along1 * v1 + side * along3 * v3;
    Eigen::Matrix3d from, to;
    from << v2, u, v2.cross(u);
    to << h * v2, h * u, (h * v2).cross(h * u);
    const Eigen::Matrix3d rotation = NearestRotation(to * from.transpose());
    Eigen::Vector3d normal = v2.cross(u);
    const Eigen::Index before = ((rays_a * normal).array() > 0).count();
    if (2 * before < rays_a.rows()) normal = -normal;
    const Eigen::Vector3d t = (h - rotation) * normal;
    if (!(t.norm() > 1e-9)) continue;
    poses.push_back({rotation, t.normalized()});
  }
  return poses;
}

}  // namespace videogrammetry
