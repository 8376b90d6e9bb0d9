#include "videogrammetry/adjustment/normal_equations.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

namespace videogrammetry {

int FindRuns(const Elimination& elimination, const int* unknown, int size, UnknownRun* runs) {
  int count = 0;
  for (int k = 0; k < size; ++k) {
    const int block = elimination.block_of[unknown[k]], place = elimination.place[unknown[k]];
    if (count > 0 && runs[count - 1].block == block && unknown[k] == unknown[k - 1] + 1 &&
        place == runs[count - 1].place + runs[count - 1].size) {
      ++runs[count - 1].size;
    } else {
      runs[count++] = {k, 1, block, place};
    }
  }
  return count;
}

int NormalEquations::Block::Column(int reduced_place) const {
  const auto found = std::lower_bound(columns.begin(), columns.end(), reduced_place);
  if (found == columns.end() || *found != reduced_place) return -1;
  return static_cast<int>(found - columns.begin());
}

NormalEquations::NormalEquations(const Network& network, const UnknownIndex& index,
                                 const Elimination& elimination, const NormalOptions& options)
    : elimination_(elimination), options_(options) {
  const Eigen::Index u = static_cast<Eigen::Index>(elimination.reduced.size());
  reduced = Eigen::MatrixXd::Zero(u, u);
  gradient = Eigen::VectorXd::Zero(index.num_unknowns);
  FindColumns(network, index);
  AddImagePoints(network, index);
  AddBars(network, index);
  AddPointPriors(network, index);
  AddCameraPriors(network, index);
  AddInterfacePriors(network, index);
  Damp();
  diagonal = reduced.diagonal();
  Eliminate(network, index);
}

void NormalEquations::FindColumns(const Network& network, const UnknownIndex& index) {
  // Runs of reduced unknowns (a camera's, a pose's, a point's) are found once each.
  using Run = std::pair<int, int>;
  std::vector<std::vector<Run>> runs(elimination_.blocks.size());
  std::vector<Run> met;
  for (const NetworkObservation& o : network.observations) {
    const NetworkImage& image = network.images[o.image];
    met.clear();
    int block = -1;
    auto meet = [&](int first, int count) {
      if (first < 0 || count == 0) return;
      if (elimination_.block_of[first] >= 0) {
        block = elimination_.block_of[first];
      } else {
        met.emplace_back(elimination_.place[first], count);
      }
    };
    auto meet_free = [&](const auto& unknowns) {  // those of one owner follow each other
      int first_free = -1, num_free = 0;
      for (const int u : unknowns) {
        if (u >= 0 && num_free++ == 0) first_free = u;
      }
      meet(first_free, num_free);
    };
    meet_free(index.camera[image.camera]);
    const int window = network.cameras[image.camera].interface;
    if (window >= 0) meet_free(index.interface[window]);
    if (image.outer >= 0) meet(index.pose[image.outer], 6);
    meet(index.pose[image.inner], 6);
    meet(index.point[o.point], 3);
    if (block >= 0) runs[block].insert(runs[block].end(), met.begin(), met.end());
  }
  blocks.resize(elimination_.blocks.size());
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    std::sort(runs[b].begin(), runs[b].end());
    runs[b].erase(std::unique(runs[b].begin(), runs[b].end()), runs[b].end());
    for (const auto& [first, count] : runs[b]) {
      for (int k = 0; k < count; ++k) blocks[b].columns.push_back(first + k);
    }
    const Eigen::Index size = static_cast<Eigen::Index>(elimination_.blocks[b].size());
    blocks[b].normal = Eigen::MatrixXd::Zero(size, size);
    blocks[b].coupling =
        Eigen::MatrixXd::Zero(size, static_cast<Eigen::Index>(blocks[b].columns.size()));
  }
}

void NormalEquations::Add(const int* unknown, int size,
                          const Eigen::Ref<const Eigen::MatrixXd>& normal,
                          const Eigen::Ref<const Eigen::VectorXd>& right) {
  std::array<UnknownRun, ImageRow::kMaxUnknowns> runs;
  const int count = FindRuns(elimination_, unknown, size, runs.data());
  Block* block = nullptr;
  for (int k = 0; k < count; ++k) {
    const UnknownRun& run = runs[k];
    gradient.segment(unknown[run.row], run.size) += right.segment(run.row, run.size);
    if (run.block >= 0) block = &blocks[run.block];
  }
  for (int j = 0; j < count; ++j) {
    const UnknownRun& b = runs[j];
    const int column = block != nullptr && b.block < 0 ? block->Column(b.place) : -1;
    for (int i = 0; i < count; ++i) {
      const UnknownRun& a = runs[i];
      const auto part = normal.block(a.row, b.row, a.size, b.size);
      if (a.block >= 0 && b.block >= 0) {
        block->normal.block(a.place, b.place, a.size, b.size) += part;
      } else if (a.block >= 0) {
        block->coupling.block(a.place, column, a.size, b.size) += part;
      } else if (b.block < 0 && a.place >= b.place) {
        reduced.block(a.place, b.place, a.size, b.size) += part;
      }
    }
  }
}

double NormalEquations::LossWeight(double square) {
  weighted_squares += square;
  if (!(options_.cauchy_scale > 0)) {
    cost += square;
    return 1.0;
  }
  const double scale2 = options_.cauchy_scale * options_.cauchy_scale;
  cost += scale2 * std::log1p(square / scale2);
  return 1.0 / (1.0 + square / scale2);
}

/// Rows of consecutive observations that meet the same camera and poses: their common part
/// goes into the normal equations as one product.
struct NormalEquations::CommonRows {
  static constexpr int kCapacity = 128;
  std::array<int, ImageRow::kMaxUnknowns> unknown;
  int size = 0, count = 0;
  Eigen::Matrix<double, ImageRow::kMaxUnknowns, Eigen::Dynamic> design, weighted;
  Eigen::VectorXd right = Eigen::VectorXd::Zero(ImageRow::kMaxUnknowns);

  CommonRows() : design(ImageRow::kMaxUnknowns, kCapacity), weighted(design) {}
  bool Fits(const ImageRow& row, int common) const {
    return count + 2 <= kCapacity && common == size &&
           std::equal(unknown.begin(), unknown.begin() + size, row.unknown.begin());
  }
};

void NormalEquations::Flush(CommonRows* rows) {
  if (rows->count > 0) {
    const Eigen::MatrixXd normal =
        rows->design.topLeftCorner(rows->size, rows->count) *
        rows->weighted.topLeftCorner(rows->size, rows->count).transpose();
    Add(rows->unknown.data(), rows->size, normal, rows->right.head(rows->size));
  }
  rows->count = 0;
  rows->right.setZero();
}

void NormalEquations::AddImagePoints(const Network& network, const UnknownIndex& index) {
  CommonRows rows;
  for (const NetworkObservation& o : network.observations) {
    if (!o.used) continue;
    const ImageRow row = LineariseObservation(network, index, o);
    if (!row.valid) {
      ++num_invalid;
      continue;
    }
    Eigen::Matrix2d weight = network.TotalCov(o).inverse();
    const Eigen::Vector2d residual = o.xy_px - row.pixel;
    num_observations += 2;
    weight *= LossWeight(residual.dot(weight * residual));
    const Eigen::Matrix<double, 2, ImageRow::kMaxUnknowns> weighted = weight * row.design;
    const int first = index.point[o.point];  // the point's unknowns come last
    const int common = row.size - (first >= 0 ? 3 : 0);
    if (!rows.Fits(row, common)) {
      Flush(&rows);
      rows.unknown = row.unknown;
      rows.size = common;
    }
    rows.design.block(0, rows.count, common, 2) = row.design.leftCols(common).transpose();
    rows.weighted.block(0, rows.count, common, 2) = weighted.leftCols(common).transpose();
    rows.count += 2;
    rows.right.head(common) += weighted.leftCols(common).transpose() * residual;
    if (first >= 0) AddToPoint(row, weighted, residual);
  }
  Flush(&rows);
}

void NormalEquations::AddToPoint(const ImageRow& row,
                                 const Eigen::Matrix<double, 2, ImageRow::kMaxUnknowns>& weighted,
                                 const Eigen::Vector2d& residual) {
  const int common = row.size - 3, first = row.unknown[common];
  const Eigen::Matrix<double, 2, 3> by_point = row.design.middleCols<3>(common);
  const Eigen::Matrix<double, 2, 3> weighted_point = weighted.middleCols<3>(common);
  const Eigen::Matrix3d own = by_point.transpose() * weighted_point;
  gradient.segment<3>(first) += weighted_point.transpose() * residual;
  const int block = elimination_.block_of[first], place = elimination_.place[first];
  if (block >= 0) {
    blocks[block].normal.block<3, 3>(place, place) += own;
  } else {
    reduced.block<3, 3>(place, place) += own;
  }
  std::array<UnknownRun, ImageRow::kMaxUnknowns> runs;
  const int count = FindRuns(elimination_, row.unknown.data(), common, runs.data());
  for (int k = 0; k < count; ++k) {
    const UnknownRun& run = runs[k];
    const Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, ImageRow::kMaxUnknowns> across =
        weighted_point.transpose().lazyProduct(row.design.middleCols(run.row, run.size));
    if (block >= 0) {  // (no run then is in a block)
      blocks[block].coupling.block(place, blocks[block].Column(run.place), 3, run.size) += across;
    } else if (run.block >= 0) {
      Block& other = blocks[run.block];
      other.coupling.block(run.place, other.Column(place), run.size, 3) += across.transpose();
    } else {
      reduced.block(place, run.place, 3, run.size) += across;  // points come last
    }
  }
}

void NormalEquations::AddBars(const Network& network, const UnknownIndex& index) {
  for (const NetworkScaleBar& bar : network.scale_bars) {
    if (!bar.used) continue;
    const BarRow row = LineariseBar(network, index, bar);
    double weight = 1 / (bar.sigma_mm * bar.sigma_mm);
    const double residual_mm = bar.length_mm - row.length_mm;
    const auto design = row.design.leftCols(row.size);
    num_prior += 1;
    bar_squares += weight * residual_mm * residual_mm;
    weight *= LossWeight(weight * residual_mm * residual_mm);
    Add(row.unknown.data(), row.size, weight * design.transpose() * design,
        weight * residual_mm * design.transpose());
  }
}

void NormalEquations::AddPointPriors(const Network& network, const UnknownIndex& index) {
  // Robustly each by itself, for a loss judges one residual as a whole.
  const bool together = !(options_.cauchy_scale > 0);
  std::vector<bool> in_block(network.points.size(), false);
  for (const int p : network.prior_block.points) in_block[p] = together;
  for (std::size_t i = 0; i < network.points.size(); ++i) {
    const NetworkPoint& p = network.points[i];
    if (!p.is_observed()) continue;
    num_prior += 3;
    if (in_block[i]) continue;
    Eigen::Matrix3d weight = p.prior_cov_mm2.inverse();
    const Eigen::Vector3d residual = p.prior_mm - p.position_mm;
    const int first = index.point[i];
    const std::array<int, 3> unknown = {first, first + 1, first + 2};
    const double square = residual.dot(weight * residual);
    point_squares += square;
    weight *= LossWeight(square);
    Add(unknown.data(), 3, weight, weight * residual);
  }
  if (together) AddPriorBlock(network, index);
}

void NormalEquations::AddPriorBlock(const Network& network, const UnknownIndex& index) {
  const PriorBlock& block = network.prior_block;
  std::vector<int> place;
  Eigen::VectorXd residual = Eigen::VectorXd::Zero(block.mean_mm.size());
  for (std::size_t i = 0; i < block.points.size(); ++i) {
    const int first = index.point[block.points[i]];
    for (int k = 0; k < 3; ++k) place.push_back(first < 0 ? -1 : elimination_.place[first + k]);
    if (first < 0) continue;
    const Eigen::Index row = 3 * static_cast<Eigen::Index>(i);
    residual.segment<3>(row) =
        block.mean_mm.segment<3>(row) - network.points[block.points[i]].position_mm;
  }
  for (std::size_t j = 0; j < place.size(); ++j) {
    for (std::size_t i = 0; i < place.size(); ++i) {
      if (place[i] < 0 || place[j] < 0 || place[i] < place[j]) continue;
      reduced(place[i], place[j]) +=
          block.weight_per_mm2(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
    }
  }
  const Eigen::VectorXd right = block.weight_per_mm2 * residual;
  for (std::size_t i = 0; i < block.points.size(); ++i) {
    const int first = index.point[block.points[i]];
    if (first >= 0) {
      gradient.segment<3>(first) += right.segment<3>(3 * static_cast<Eigen::Index>(i));
    }
  }
  const double square = residual.dot(right);
  point_squares += square;
  weighted_squares += square;
  cost += square;
}

void NormalEquations::AddPrior(int unknown, double residual, double sigma) {
  const double weight = 1 / (sigma * sigma), square = weight * residual * residual;
  const int place = elimination_.place[unknown];
  reduced(place, place) += weight;
  gradient[unknown] += weight * residual;
  num_prior += 1;
  weighted_squares += square;
  cost += square;
}

void NormalEquations::AddCameraPriors(const Network& network, const UnknownIndex& index) {
  for (std::size_t c = 0; c < network.cameras.size(); ++c) {
    const NetworkCamera& camera = network.cameras[c];
    const CameraVector values = camera.values();
    for (int k = 0; k < kNumCameraUnknowns; ++k) {
      const int u = index.camera[c][k];
      if (u < 0 || !(camera.prior_sigma[k] > 0)) continue;
      AddPrior(u, camera.start[k] - values[k], camera.prior_sigma[k]);
    }
  }
}

void NormalEquations::AddInterfacePriors(const Network& network, const UnknownIndex& index) {
  for (std::size_t i = 0; i < network.interfaces.size(); ++i) {
    const NetworkInterface& window = network.interfaces[i];
    const Eigen::Vector3d change = window.start() - window.values();
    for (int k = 0; k < kNumInterfaceUnknowns; ++k) {
      const int u = index.interface[i][k];
      if (u < 0 || !(window.prior_sigma[k] > 0)) continue;
      AddPrior(u, change[k], window.prior_sigma[k]);
    }
  }
}

void NormalEquations::Damp() {
  reduced.diagonal() *= 1 + options_.damping;
  for (Block& block : blocks) block.normal.diagonal() *= 1 + options_.damping;
}

}  // namespace videogrammetry
