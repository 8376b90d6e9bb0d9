#include "videogrammetry/adjustment/spd_inverse.h"

#include <Eigen/Cholesky>
#include <algorithm>

#include "videogrammetry/core/thread_pool.h"

namespace videogrammetry {
namespace {

// Below this, Eigen's own blocking and one thread are best.
constexpr Eigen::Index kSmall = 256;
constexpr Eigen::Index kChunk = 192;

using Part = Eigen::Ref<Eigen::MatrixXd>;

/// Calls body(first, size) for chunks of [0, n), in threads.
template <typename Body>
void ForChunks(Eigen::Index n, int num_threads, const Body& body) {
  ParallelFor(static_cast<int>((n + kChunk - 1) / kChunk), num_threads, [&](int i) {
    const Eigen::Index first = i * kChunk;
    body(first, std::min(kChunk, n - first));
  });
}

/// Lower triangle of a += sign B B'.
void AddProduct(double sign, const Eigen::Ref<const Eigen::MatrixXd>& b, Part a, int num_threads) {
  ForChunks(a.rows(), num_threads, [&](Eigen::Index first, Eigen::Index size) {
    const Eigen::Index below = a.rows() - first - size;
    a.block(first, first, size, size)
        .selfadjointView<Eigen::Lower>()
        .rankUpdate(b.middleRows(first, size), sign);
    a.block(first + size, first, below, size).noalias() +=
        sign * b.bottomRows(below) * b.middleRows(first, size).transpose();
  });
}

/// Cholesky by halves: L11, L21 = A21 L11^-T, then A22 - L21 L21'.
bool Factor(Part l, int num_threads) {
  const Eigen::Index n = l.rows(), h = n / 2;
  if (n <= kSmall) return Eigen::LLT<Part>(l).info() == Eigen::Success;
  Part a = l.topLeftCorner(h, h), b = l.bottomLeftCorner(n - h, h),
       c = l.bottomRightCorner(n - h, n - h);
  if (!Factor(a, num_threads)) return false;
  ForChunks(n - h, num_threads, [&](Eigen::Index first, Eigen::Index size) {
    a.triangularView<Eigen::Lower>().transpose().solveInPlace<Eigen::OnTheRight>(
        b.middleRows(first, size));
  });
  AddProduct(-1.0, b, c, num_threads);
  return Factor(c, num_threads);
}

/// L <- L^-1: [A 0; B C]^-1 = [A^-1 0; -C^-1 B A^-1 C^-1].
void InvertTriangle(Part l, int num_threads) {
  const Eigen::Index n = l.rows(), h = n / 2;
  if (n <= kSmall) {
    Eigen::MatrixXd inverse = Eigen::MatrixXd::Identity(n, n);
    l.triangularView<Eigen::Lower>().solveInPlace(inverse);
    l.triangularView<Eigen::Lower>() = inverse;
    return;
  }
  Part a = l.topLeftCorner(h, h), b = l.bottomLeftCorner(n - h, h),
       c = l.bottomRightCorner(n - h, n - h);
  ForChunks(n - h, num_threads, [&](Eigen::Index first, Eigen::Index size) {
    a.triangularView<Eigen::Lower>().solveInPlace<Eigen::OnTheRight>(b.middleRows(first, size));
  });
  ForChunks(h, num_threads, [&](Eigen::Index first, Eigen::Index size) {
    c.triangularView<Eigen::Lower>().solveInPlace(b.middleCols(first, size));
    b.middleCols(first, size) *= -1.0;
  });
  InvertTriangle(a, num_threads);
  InvertTriangle(c, num_threads);
}

/// Lower triangle of L'L: [A'A + B'B .; C'B C'C].
void TransposeProduct(Part l, int num_threads) {
  const Eigen::Index n = l.rows(), h = n / 2;
  if (n <= kSmall) {
    const Eigen::MatrixXd m = l.triangularView<Eigen::Lower>();
    l.triangularView<Eigen::Lower>() = m.transpose() * m;
    return;
  }
  Part a = l.topLeftCorner(h, h), b = l.bottomLeftCorner(n - h, h),
       c = l.bottomRightCorner(n - h, n - h);
  TransposeProduct(a, num_threads);
  AddProduct(1.0, b.transpose().eval(), a, num_threads);
  ForChunks(h, num_threads, [&](Eigen::Index first, Eigen::Index size) {
    b.middleCols(first, size) =
        (c.triangularView<Eigen::Lower>().transpose() * b.middleCols(first, size)).eval();
  });
  TransposeProduct(c, num_threads);
}

}  // namespace

double FactorInPlace(Eigen::MatrixXd* a, int num_threads) {
  if (a->rows() == 0) return 1.0;
  if (!Factor(*a, num_threads)) return 0.0;
  return a->diagonal().cwiseAbs2().minCoeff();
}

void InvertFactorInPlace(Eigen::MatrixXd* l, int num_threads) {
  InvertTriangle(*l, num_threads);
  TransposeProduct(*l, num_threads);
}

}  // namespace videogrammetry
