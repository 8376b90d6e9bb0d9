#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "videogrammetry/adjustment/datum.h"
#include "videogrammetry/adjustment/normal_equations.h"
#include "videogrammetry/adjustment/spd_inverse.h"

// What becomes of normal equations once they are made: elimination and solution.
namespace videogrammetry {
namespace {

[[noreturn]] void ThrowSingularBlock(const Network& network, const UnknownIndex& index,
                                     int unknown) {
  for (std::size_t p = 0; p < network.points.size(); ++p) {
    const int first = index.point[p];
    if (first < 0 || unknown < first || unknown >= first + 3) continue;
    throw UndeterminedPointError(
        "point " + std::to_string(network.points[p].id) +
            " is not determined: too few pictures see it, or all along one line",
        static_cast<int>(p));
  }
  throw AdjustmentError(
      "the observations do not determine all unknowns (rank defect); free to move: " +
      UnknownName(network, index, unknown));
}

/// Lower triangle of all[columns, columns] -= part; columns ascend.
void Subtract(const Eigen::MatrixXd& part, const std::vector<int>& columns, Eigen::MatrixXd* all) {
  const std::size_t n = columns.size();
  for (std::size_t i = 0; i < n;) {  // runs of rows that lie next to each other
    std::size_t end = i + 1;
    while (end < n && columns[end] == columns[end - 1] + 1) ++end;
    for (std::size_t j = 0; j < end; ++j) {
      const std::size_t first = std::max(i, j);
      const Eigen::Index size = static_cast<Eigen::Index>(end - first);
      all->col(columns[j]).segment(columns[first], size) -=
          part.col(static_cast<Eigen::Index>(j)).segment(static_cast<Eigen::Index>(first), size);
    }
    i = end;
  }
}

}  // namespace

Eigen::MatrixXd ScaledReduced(const Eigen::MatrixXd& reduced, const Eigen::VectorXd& diagonal,
                              const Elimination& elimination, const Eigen::MatrixXd& null_space) {
  const Eigen::VectorXd scale = diagonal.cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd scaled(reduced.rows(), reduced.cols());
  for (Eigen::Index j = 0; j < scaled.cols(); ++j) {
    const Eigen::Index size = scaled.rows() - j;
    scaled.col(j).tail(size) = scale[j] * scale.tail(size).cwiseProduct(reduced.col(j).tail(size));
  }
  if (null_space.cols() > 0) {
    const Eigen::MatrixXd g = null_space(elimination.reduced, Eigen::all);
    scaled.selfadjointView<Eigen::Lower>().rankUpdate(
        Orthonormalised(scale.cwiseInverse().asDiagonal() * g));
  }
  return scaled;
}

void NormalEquations::Eliminate(const Network& network, const UnknownIndex& index) {
  // W_b' W_b is what a block takes from the reduced ones. Where most blocks meet most of these,
  // many W at once are one large product; else each goes to its columns.
  double met = 0.0;
  for (const Block& block : blocks) met += std::pow(static_cast<double>(block.columns.size()), 2);
  const bool dense = met > 0.2 * std::pow(static_cast<double>(reduced.rows()), 2) *
                               static_cast<double>(blocks.size());
  constexpr Eigen::Index kRows = 192;
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(reduced.rows(), dense ? kRows : 0);
  Eigen::Index count = 0;
  auto take = [&] {
    reduced.selfadjointView<Eigen::Lower>().rankUpdate(all.leftCols(count), -1.0);
    all.leftCols(count).setZero();
    count = 0;
  };
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    Block& block = blocks[b];
    const Eigen::VectorXd scale = block.normal.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::LLT<Eigen::MatrixXd> factor(scale.asDiagonal() * block.normal *
                                             scale.asDiagonal());
    if (!scale.allFinite() || factor.info() != Eigen::Success ||
        factor.matrixLLT().diagonal().cwiseAbs2().minCoeff() < kRankTolerance) {
      ThrowSingularBlock(network, index, elimination_.blocks[b].front());
    }
    const Eigen::Index size = scale.size();
    Eigen::MatrixXd root = scale.asDiagonal();  // L^-1 diag(scale)
    factor.matrixL().solveInPlace(root);
    block.inverse = root.transpose().lazyProduct(root);
    block.y.noalias() = block.inverse.lazyProduct(block.coupling);
    if (!dense) {
      Subtract(block.coupling.transpose() * block.y, block.columns, &reduced);
      continue;
    }
    if (count + size > kRows) take();
    const Eigen::MatrixXd w = (root.lazyProduct(block.coupling)).transpose();
    for (Eigen::Index k = 0; k < size; ++k, ++count) {
      for (std::size_t i = 0; i < block.columns.size(); ++i) {
        all(block.columns[i], count) = w(static_cast<Eigen::Index>(i), k);
      }
    }
  }
  if (dense) take();
}

std::optional<Eigen::VectorXd> NormalEquations::Solve(const Eigen::MatrixXd& null_space,
                                                      int num_threads) const {
  const Eigen::VectorXd scale = diagonal.cwiseSqrt().cwiseInverse();
  if (!scale.allFinite()) return std::nullopt;
  // Right-hand side of the reduced vector: g_r - sum_b Y_b' g_b.
  Eigen::VectorXd right = gradient(elimination_.reduced);
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const Eigen::VectorXd own = gradient(elimination_.blocks[b]);
    const Eigen::VectorXd by_block = blocks[b].y.transpose() * own;
    for (std::size_t k = 0; k < blocks[b].columns.size(); ++k) {
      right[blocks[b].columns[k]] -= by_block[static_cast<Eigen::Index>(k)];
    }
  }
  Eigen::MatrixXd factor = ScaledReduced(reduced, diagonal, elimination_, null_space);
  if (!(FactorInPlace(&factor, num_threads) > kRankTolerance)) return std::nullopt;
  Eigen::VectorXd x = scale.cwiseProduct(right);
  factor.triangularView<Eigen::Lower>().solveInPlace(x);
  factor.triangularView<Eigen::Lower>().transpose().solveInPlace(x);
  x.array() *= scale.array();
  Eigen::VectorXd step(gradient.size());
  step(elimination_.reduced) = x;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const Eigen::VectorXd own = gradient(elimination_.blocks[b]);
    step(elimination_.blocks[b]) = blocks[b].inverse * own - blocks[b].y * x(blocks[b].columns);
  }
  return step;
}

}  // namespace videogrammetry
