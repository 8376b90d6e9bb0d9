#include "videogrammetry/adjustment/spd_inverse.h"

#include <Eigen/Cholesky>

namespace videogrammetry {
namespace {

constexpr Eigen::Index kBlock = 64;

using Part = Eigen::Ref<Eigen::MatrixXd>;

/// L <- L^-1, recursively: [A 0; B C]^-1 = [A^-1 0; -C^-1 B A^-1 C^-1].
void InvertTriangle(Part l) {
  const Eigen::Index n = l.rows(), h = n / 2;
  if (n <= kBlock) {
    Eigen::MatrixXd inverse = Eigen::MatrixXd::Identity(n, n);
    l.triangularView<Eigen::Lower>().solveInPlace(inverse);
    l.triangularView<Eigen::Lower>() = inverse;
    return;
  }
  Part a = l.topLeftCorner(h, h), b = l.bottomLeftCorner(n - h, h),
       c = l.bottomRightCorner(n - h, n - h);
  a.triangularView<Eigen::Lower>().solveInPlace<Eigen::OnTheRight>(b);
  c.triangularView<Eigen::Lower>().solveInPlace(b);
  b *= -1.0;
  InvertTriangle(a);
  InvertTriangle(c);
}

/// Lower triangle of L'L, recursively: [A'A + B'B .; C'B C'C].
void TransposeProduct(Part l) {
  const Eigen::Index n = l.rows(), h = n / 2;
  if (n <= kBlock) {
    const Eigen::MatrixXd m = l.triangularView<Eigen::Lower>();
    l.triangularView<Eigen::Lower>() = m.transpose() * m;
    return;
  }
  Part a = l.topLeftCorner(h, h), b = l.bottomLeftCorner(n - h, h),
       c = l.bottomRightCorner(n - h, n - h);
  TransposeProduct(a);
  a.selfadjointView<Eigen::Lower>().rankUpdate(b.transpose());
  b = c.transpose().triangularView<Eigen::Upper>() * b;
  TransposeProduct(c);
}

}  // namespace

double FactorInPlace(Eigen::MatrixXd* a, int /*num_threads*/) {
  if (a->rows() == 0) return 1.0;
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(*a);
  if (factor.info() != Eigen::Success) return 0.0;
  return a->diagonal().cwiseAbs2().minCoeff();
}

void InvertFactorInPlace(Eigen::MatrixXd* l, int /*num_threads*/) {
  InvertTriangle(*l);
  TransposeProduct(*l);
}

}  // namespace videogrammetry
