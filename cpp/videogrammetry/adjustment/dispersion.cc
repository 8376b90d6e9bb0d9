#include "videogrammetry/adjustment/dispersion.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <sstream>

#include "videogrammetry/adjustment/datum.h"
#include "videogrammetry/adjustment/spd_inverse.h"
#include "videogrammetry/core/errors.h"
#include "videogrammetry/core/thread_pool.h"

namespace videogrammetry {
namespace {

/// Fills what FullCovariance leaves out: eliminated by reduced, and the
/// blocks' lower triangle (block a by an earlier block b).
void Mirror(const Elimination& elimination, Eigen::MatrixXd* full) {
  const Eigen::Index u = full->rows();
  constexpr Eigen::Index kTile = 64;  // both tiles stay in the cache
  auto is_known = [&](Eigen::Index i, Eigen::Index j) {
    const int a = elimination.block_of[i], b = elimination.block_of[j];
    return a < 0 || (b >= 0 && a <= b);
  };
  for (Eigen::Index jj = 0; jj < u; jj += kTile) {
    for (Eigen::Index ii = 0; ii < u; ii += kTile) {
      for (Eigen::Index j = jj; j < std::min(u, jj + kTile); ++j) {
        for (Eigen::Index i = ii; i < std::min(u, ii + kTile); ++i) {
          if (!is_known(i, j)) (*full)(i, j) = (*full)(j, i);
        }
      }
    }
  }
}

std::vector<int> PlacesOf(const Elimination& elimination, const std::vector<int>& unknowns) {
  std::vector<int> places;
  for (const int u : unknowns) places.push_back(elimination.place[u]);
  return places;
}

std::vector<int> Range(int first, int end) {
  std::vector<int> all(static_cast<std::size_t>(end - first));
  std::iota(all.begin(), all.end(), first);
  return all;
}

}  // namespace

Dispersion::Dispersion(const Network& network, Elimination::What what, int num_threads)
    : network_(network),
      index_(network),
      elimination_(network, index_, what),
      normal_(network, index_, elimination_),
      null_space_(DatumNullSpace(network, index_)) {
  Invert(num_threads);
  ApplyDatum();
  SpreadToBlocks(num_threads);
}

void Dispersion::Invert(int num_threads) {
  const Eigen::VectorXd scale = normal_.diagonal.cwiseSqrt().cwiseInverse();
  if (!scale.allFinite()) ThrowRankDefect(scale);
  cov_ = ScaledReduced(normal_.reduced, normal_.diagonal, elimination_, null_space_);
  normal_.reduced.resize(0, 0);
  // The upper triangle and this keep the matrix, for the words about a rank defect.
  unit_diagonal_ = cov_.diagonal();
  cov_.triangularView<Eigen::StrictlyUpper>() = cov_.transpose();
  if (!(FactorInPlace(&cov_, num_threads) > kRankTolerance)) ThrowRankDefect(scale);
  InvertFactorInPlace(&cov_, num_threads);
  for (Eigen::Index j = 0; j < cov_.cols(); ++j) {
    cov_.col(j).tail(cov_.rows() - j).array() *= scale[j] * scale.tail(cov_.rows() - j).array();
  }
  cov_.triangularView<Eigen::StrictlyUpper>() = cov_.transpose();
}

void Dispersion::ApplyDatum() {
  const int d = datum_size();
  datum_ = Eigen::MatrixXd::Zero(index_.num_unknowns, d);
  if (d == 0) return;
  // H over the points; its columns of other unknowns are zero.
  Eigen::MatrixXd h = Eigen::MatrixXd::Zero(d, index_.num_unknowns);
  const Eigen::Index p = index_.num_unknowns - index_.num_orientation;
  const auto g_p = null_space_.bottomRows(p);
  h.rightCols(p) = (g_p.transpose() * g_p).ldlt().solve(g_p.transpose());
  // HT = H_r - sum_b H_b Y_b, and M = D H'.
  Eigen::MatrixXd ht = h(Eigen::all, elimination_.reduced);
  Eigen::MatrixXd hdh = Eigen::MatrixXd::Zero(d, d);
  for (std::size_t b = 0; b < normal_.blocks.size(); ++b) {
    const NormalEquations::Block& block = normal_.blocks[b];
    const Eigen::MatrixXd h_b = h(Eigen::all, elimination_.blocks[b]);
    if (h_b.isZero(0)) continue;
    const Eigen::MatrixXd m = block.inverse * h_b.transpose();
    datum_(elimination_.blocks[b], Eigen::all) = m;
    hdh += h_b * m;
    ht(Eigen::all, block.columns) -= h_b * block.y;
  }
  const Eigen::MatrixXd g = null_space_(elimination_.reduced, Eigen::all);
  const Eigen::MatrixXd k = cov_ * ht.transpose();  // (H T Q_rr)'
  const Eigen::MatrixXd hqh = ht * k + hdh;         // H Q' H'
  const Eigen::MatrixXd half = k - 0.5 * g * hqh;
  cov_.noalias() -= g * half.transpose();
  cov_.noalias() -= half * g.transpose();
}

void Dispersion::SpreadToBlocks(int num_threads) {
  block_cov_.resize(normal_.blocks.size());
  ParallelFor(static_cast<int>(block_cov_.size()), num_threads, [&](int b) {
    const NormalEquations::Block& block = normal_.blocks[b];
    BlockCov& q = block_cov_[b];
    q.by_columns.noalias() = -block.y * cov_(block.columns, block.columns);
    q.own = block.inverse - q.by_columns * block.y.transpose();
    if (datum_size() > 0) {
      std::vector<int> met;
      for (const int place : block.columns) met.push_back(elimination_.reduced[place]);
      const Eigen::MatrixXd m = datum_(elimination_.blocks[b], Eigen::all);
      const Eigen::MatrixXd cross = null_space_(elimination_.blocks[b], Eigen::all) * m.transpose();
      q.by_columns.noalias() -= m * null_space_(met, Eigen::all).transpose();
      q.own -= cross + cross.transpose();
    }
    q.own = 0.5 * (q.own + q.own.transpose().eval());
  });
}

void Dispersion::ThrowRankDefect(const Eigen::VectorXd& scale) const {
  std::vector<int> free;  // unknowns, the freest first
  for (Eigen::Index i = 0; i < scale.size(); ++i) {
    if (!std::isfinite(scale[i])) free.push_back(elimination_.reduced[i]);
  }
  if (free.empty()) {
    // Inverse iteration on a small shift: what remains of random vectors is what
    // can move freely, and the rows of its projector show which unknowns that is.
    const Eigen::Index n = scale.size(), count = std::min<Eigen::Index>(n, 8);
    Eigen::MatrixXd shifted = cov_.selfadjointView<Eigen::Upper>();
    shifted.diagonal() = unit_diagonal_.array() + 1e-9;
    const Eigen::LDLT<Eigen::MatrixXd> factor(shifted);
    Eigen::MatrixXd v = Orthonormalised(Eigen::MatrixXd::Random(n, count));
    for (int i = 0; i < 3; ++i) v = Orthonormalised(factor.solve(v));
    shifted.diagonal() = unit_diagonal_;
    Eigen::VectorXd moves = Eigen::VectorXd::Zero(n);
    const Eigen::VectorXd value = (v.transpose() * shifted * v).diagonal().cwiseAbs();
    const double least = value.minCoeff();
    for (Eigen::Index k = 0; k < count; ++k) {
      if (value[k] <= std::max(1e-9, 10 * least)) moves += v.col(k).cwiseAbs2();
    }
    std::vector<int> order = Range(0, static_cast<int>(n));
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return moves[a] > moves[b]; });
    for (const int i : order) {
      if (moves[i] > 0.04 * moves.maxCoeff()) free.push_back(elimination_.reduced[i]);
    }
  }
  const std::vector<std::string> names = UnknownNames(network_, index_);
  std::ostringstream list;
  for (std::size_t i = 0; i < free.size() && i < 8; ++i) {
    list << (i > 0 ? ", " : "") << names[free[i]];
  }
  if (free.size() > 8) list << " and " << free.size() - 8 << " more";
  throw AdjustmentError("the observations do not determine all unknowns (rank defect); free to " +
                        std::string("move: ") + list.str());
}

double Dispersion::CovOf(int a, int b) const {
  const int block_a = elimination_.block_of[a], block_b = elimination_.block_of[b];
  const int place_a = elimination_.place[a], place_b = elimination_.place[b];
  if (block_a < 0 && block_b < 0) return cov_(place_a, place_b);
  if (block_a >= 0 && block_a == block_b) return block_cov_[block_a].own(place_a, place_b);
  if (block_a < 0) return CovOf(b, a);
  const int column = block_b < 0 ? normal_.blocks[block_a].Column(place_b) : -1;
  return column >= 0 ? block_cov_[block_a].by_columns(place_a, column) : Covariance({a}, {b})(0, 0);
}

Eigen::MatrixXd Dispersion::Expansion(const std::vector<int>& unknowns,
                                      std::vector<int>* columns) const {
  columns->clear();
  for (const int u : unknowns) {
    const int b = elimination_.block_of[u];
    if (b < 0) {
      columns->push_back(elimination_.place[u]);
    } else {
      const auto& met = normal_.blocks[b].columns;
      columns->insert(columns->end(), met.begin(), met.end());
    }
  }
  std::sort(columns->begin(), columns->end());
  columns->erase(std::unique(columns->begin(), columns->end()), columns->end());
  auto column = [&](int place) {
    return std::lower_bound(columns->begin(), columns->end(), place) - columns->begin();
  };
  Eigen::MatrixXd t = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(unknowns.size()),
                                            static_cast<Eigen::Index>(columns->size()));
  for (std::size_t i = 0; i < unknowns.size(); ++i) {
    const Eigen::Index row = static_cast<Eigen::Index>(i);
    const int b = elimination_.block_of[unknowns[i]], place = elimination_.place[unknowns[i]];
    if (b < 0) {
      t(row, column(place)) = 1.0;
      continue;
    }
    const NormalEquations::Block& block = normal_.blocks[b];
    for (std::size_t k = 0; k < block.columns.size(); ++k) {
      t(row, column(block.columns[k])) = -block.y(place, static_cast<Eigen::Index>(k));
    }
  }
  return t;
}

Eigen::MatrixXd Dispersion::Covariance(const std::vector<int>& a, const std::vector<int>& b) const {
  const auto is_reduced = [&](int u) { return elimination_.block_of[u] < 0; };
  if (std::all_of(a.begin(), a.end(), is_reduced) && std::all_of(b.begin(), b.end(), is_reduced)) {
    return cov_(PlacesOf(elimination_, a), PlacesOf(elimination_, b));
  }
  std::vector<int> columns_a, columns_b;
  const Eigen::MatrixXd t_a = Expansion(a, &columns_a), t_b = Expansion(b, &columns_b);
  Eigen::MatrixXd q = t_a * cov_(columns_a, columns_b) * t_b.transpose();
  if (datum_size() > 0) {
    q.noalias() -= null_space_(a, Eigen::all) * datum_(b, Eigen::all).transpose();
    q.noalias() -= datum_(a, Eigen::all) * null_space_(b, Eigen::all).transpose();
  }
  for (std::size_t i = 0; i < a.size(); ++i) {
    const int block = elimination_.block_of[a[i]];
    for (std::size_t j = 0; block >= 0 && j < b.size(); ++j) {
      if (elimination_.block_of[b[j]] != block) continue;
      q(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) +=
          normal_.blocks[block].inverse(elimination_.place[a[i]], elimination_.place[b[j]]);
    }
  }
  return q;
}

Eigen::MatrixXd Dispersion::CovOrientation() const {
  const std::vector<int> all = Range(0, index_.num_orientation);
  // Few eliminated ones cost little one by one, many less together.
  const auto is_reduced = [&](int u) { return elimination_.block_of[u] < 0; };
  if (all.size() < 300 || std::all_of(all.begin(), all.end(), is_reduced)) {
    return Covariance(all, all);
  }
  return FullCovariance().topLeftCorner(index_.num_orientation, index_.num_orientation);
}

Eigen::Matrix3d Dispersion::CovPoint(int point) const {
  const int first = index_.point[point];
  if (first < 0) {
    return Eigen::Matrix3d::Constant(
        network_.points[point].starved ? std::numeric_limits<double>::quiet_NaN() : 0.0);
  }
  Eigen::Matrix3d cov;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) cov(i, j) = CovOf(first + i, first + j);
  }
  return cov;
}

Eigen::MatrixXd Dispersion::CovPoints(const std::vector<int>& points) const {
  const Eigen::Index size = 3 * static_cast<Eigen::Index>(points.size());
  Eigen::MatrixXd cov = Eigen::MatrixXd::Zero(size, size);
  std::vector<int> unknowns, rows;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const int first = index_.point[points[i]];
    for (int k = 0; k < 3; ++k) {
      const int row = 3 * static_cast<int>(i) + k;
      if (first >= 0) {
        unknowns.push_back(first + k);
        rows.push_back(row);
      } else if (network_.points[points[i]].starved) {
        cov.row(row).setConstant(std::numeric_limits<double>::quiet_NaN());
        cov.col(row).setConstant(std::numeric_limits<double>::quiet_NaN());
      }
    }
  }
  cov(rows, rows) = Covariance(unknowns, unknowns);
  return cov;
}

Eigen::MatrixXd Dispersion::FullCovariance(int num_threads) const {
  // Q T' of each eliminated block's columns first, then T from the left: an eliminated
  // block meets few of the reduced unknowns, so that this is far less than (1) as it stands.
  const Eigen::Index u = index_.num_unknowns;
  const int count = static_cast<int>(normal_.blocks.size());
  const std::vector<int>& reduced = elimination_.reduced;
  Eigen::MatrixXd full = Eigen::MatrixXd::Zero(u, u);
  std::vector<Eigen::MatrixXd> across(normal_.blocks.size());  // Q_rr Y', (R, b)
  ParallelFor(count, num_threads, [&](int b) {
    const NormalEquations::Block& block = normal_.blocks[b];
    Eigen::MatrixXd gathered(cov_.rows(), std::min<Eigen::Index>(64, block.y.cols()));
    across[b] = Eigen::MatrixXd::Zero(cov_.rows(), block.y.rows());
    for (Eigen::Index first = 0; first < block.y.cols(); first += gathered.cols()) {
      const Eigen::Index size = std::min(gathered.cols(), block.y.cols() - first);
      for (Eigen::Index k = 0; k < size; ++k) {
        gathered.col(k) = cov_.col(block.columns[static_cast<std::size_t>(first + k)]);
      }
      across[b].noalias() += gathered.leftCols(size) * block.y.middleCols(first, size).transpose();
    }
  });
  ParallelFor(count, num_threads, [&](int b) {
    const std::vector<int>& own = elimination_.blocks[b];
    for (std::size_t k = 0; k < own.size(); ++k) {
      const Eigen::Index column = static_cast<Eigen::Index>(k);
      for (std::size_t r = 0; r < reduced.size(); ++r) {
        full(reduced[r], own[k]) = -across[b](static_cast<Eigen::Index>(r), column);
      }
    }
    for (int a = 0; a <= b; ++a) {
      const NormalEquations::Block& block = normal_.blocks[a];
      full(elimination_.blocks[a], own) = block.y * across[b](block.columns, Eigen::all);
    }
    full(own, own) += normal_.blocks[b].inverse;
  });
  for (std::size_t j = 0; j < reduced.size(); ++j) {
    for (std::size_t i = 0; i < reduced.size(); ++i) {
      full(reduced[i], reduced[j]) =
          cov_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
    }
  }
  Mirror(elimination_, &full);
  if (!datum_.isZero(0)) {
    full.noalias() -= null_space_ * datum_.transpose();
    full.noalias() -= datum_ * null_space_.transpose();
  }
  return full;
}

void Dispersion::ApplyCondition(const std::vector<int>& which, const Eigen::VectorXd& change,
                                Network* network) const {
  const Eigen::MatrixXd columns = Covariance(Range(0, index_.num_unknowns), which);
  Eigen::MatrixXd block = columns(which, Eigen::all);
  // Unit diagonal: A1 and A3 differ by twelve powers of ten.
  const Eigen::VectorXd scale = block.diagonal().cwiseSqrt().cwiseInverse();
  block = scale.asDiagonal() * block * scale.asDiagonal();
  const Eigen::VectorXd factor = scale.cwiseProduct(block.ldlt().solve(scale.cwiseProduct(change)));
  const Eigen::VectorXd step = columns * factor;
  MoveUnknowns(index_, step, network);
}

}  // namespace videogrammetry
