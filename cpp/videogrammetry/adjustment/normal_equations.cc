#include "videogrammetry/adjustment/normal_equations.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "videogrammetry/adjustment/observation_model.h"

namespace videogrammetry {
namespace {

// Below this share of its unit diagonal a pivot is rounding: about 1e4 times
// the double's epsilon, and far under what a solvable network shows (1e-9).
constexpr double kRankTolerance = 1e-12;

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

ImageRow MakeRow(const Network& network, int image_index, const UnknownIndex& index, int point,
                 const std::optional<Eigen::Vector2d>& pixel, const ImagePointJacobians& j) {
  const NetworkImage& image = network.images[image_index];
  ImageRow row;
  if (!pixel) return row;
  row.valid = true;
  row.pixel = *pixel;
  auto add = [&](int unknown, const Eigen::Vector2d& column) {
    row.design.col(row.size) = column;
    row.unknown[row.size++] = unknown;
  };
  for (int k = 0; k < kNumCameraUnknowns; ++k) {
    const int u = index.camera[image.camera][k];
    if (u >= 0) add(u, j.by_camera.col(k));
  }
  const int outer = image.outer < 0 ? -1 : index.pose[image.outer], inner = index.pose[image.inner];
  for (int k = 0; outer >= 0 && k < 6; ++k) add(outer + k, j.by_outer.col(k));
  for (int k = 0; inner >= 0 && k < 6; ++k) add(inner + k, j.by_inner.col(k));
  const int window = network.cameras[image.camera].interface;
  if (window >= 0) {
    Eigen::Matrix<double, 3, 2> normal_by_tilt;
    network.interfaces[window].surface(&normal_by_tilt);
    Eigen::Matrix<double, 2, kNumInterfaceUnknowns> by_interface;
    by_interface << j.by_normal * normal_by_tilt, j.by_distance;
    for (int k = 0; k < kNumInterfaceUnknowns; ++k) {
      const int u = index.interface[window][k];
      if (u >= 0) add(u, by_interface.col(k));
    }
  }
  for (int k = 0; index.point[point] >= 0 && k < 3; ++k) {
    add(index.point[point] + k, j.by_point.col(k));
  }
  return row;
}

}  // namespace

ImageRow LineariseImagePoint(const Network& network, const UnknownIndex& index, int image,
                             int point, const Eigen::Vector2d& velocity_px) {
  ImagePointJacobians j;
  const auto pixel = PredictImagePoint(network, image, point, velocity_px, &j);
  return MakeRow(network, image, index, point, pixel, j);
}

ImageRow LineariseObservation(const Network& network, const UnknownIndex& index,
                              const NetworkObservation& o) {
  ImagePointJacobians j;
  const auto pixel = PredictObservation(network, o, &j);
  return MakeRow(network, o.image, index, o.point, pixel, j);
}

BarRow LineariseBar(const Network& network, const UnknownIndex& index, const NetworkScaleBar& bar) {
  const Eigen::Vector3d between =
      network.points[bar.a].position_mm - network.points[bar.b].position_mm;
  BarRow row;
  row.length_mm = between.norm();
  const Eigen::Vector3d along = between / std::max(row.length_mm, 1e-300);
  for (const auto& [point, sign] : {std::pair(bar.a, 1.0), std::pair(bar.b, -1.0)}) {
    for (int k = 0; index.point[point] >= 0 && k < 3; ++k) {
      row.design[row.size] = sign * along[k];
      row.unknown[row.size++] = index.point[point] + k;
    }
  }
  return row;
}

int NormalEquations::Block::Column(int reduced_place) const {
  const auto found = std::lower_bound(columns.begin(), columns.end(), reduced_place);
  if (found == columns.end() || *found != reduced_place) return -1;
  return static_cast<int>(found - columns.begin());
}

NormalEquations::NormalEquations(const Network& network, const UnknownIndex& index,
                                 const Elimination& elimination)
    : elimination_(elimination) {
  const Eigen::Index u = static_cast<Eigen::Index>(elimination.reduced.size());
  reduced = Eigen::MatrixXd::Zero(u, u);
  FindColumns(network, index);
  AddImagePoints(network, index);
  AddBars(network, index);
  AddPointPriors(network, index);
  AddPriorBlock(network, index);
  AddCameraPriors(network, index);
  AddInterfacePriors(network, index);
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
                          const Eigen::Ref<const Eigen::MatrixXd>& normal) {
  std::array<int, ImageRow::kMaxUnknowns> column;  // in the block, of reduced unknowns
  Block* block = nullptr;
  for (int i = 0; i < size; ++i) {
    const int b = elimination_.block_of[unknown[i]];
    if (b >= 0) block = &blocks[b];
  }
  for (int i = 0; block != nullptr && i < size; ++i) {
    if (elimination_.block_of[unknown[i]] >= 0) continue;
    const int place = elimination_.place[unknown[i]];
    const bool next = i > 0 && elimination_.block_of[unknown[i - 1]] < 0 &&
                      elimination_.place[unknown[i - 1]] + 1 == place;
    column[i] = next ? column[i - 1] + 1 : block->Column(place);
  }
  for (int j = 0; j < size; ++j) {
    const bool j_out = elimination_.block_of[unknown[j]] >= 0;
    const int place_j = elimination_.place[unknown[j]];
    for (int i = 0; i < size; ++i) {
      const int place_i = elimination_.place[unknown[i]];
      const bool i_out = elimination_.block_of[unknown[i]] >= 0;
      if (!i_out && !j_out) {
        if (place_i >= place_j) reduced(place_i, place_j) += normal(i, j);
      } else if (i_out && j_out) {
        block->normal(place_i, place_j) += normal(i, j);
      } else if (i_out) {
        block->coupling(place_i, column[j]) += normal(i, j);
      }
    }
  }
}

void NormalEquations::AddImagePoints(const Network& network, const UnknownIndex& index) {
  Eigen::MatrixXd normal(ImageRow::kMaxUnknowns, ImageRow::kMaxUnknowns);
  for (const NetworkObservation& o : network.observations) {
    if (!o.used) continue;
    const ImageRow row = LineariseObservation(network, index, o);
    if (!row.valid) continue;
    const Eigen::Matrix2d weight = network.TotalCov(o).inverse();
    const Eigen::Vector2d residual = o.xy_px - row.pixel;
    num_observations += 2;
    weighted_squares += residual.dot(weight * residual);
    const auto design = row.design.leftCols(row.size);
    const Eigen::Matrix<double, 2, ImageRow::kMaxUnknowns> weighted = weight * row.design;
    normal.topLeftCorner(row.size, row.size) =
        design.transpose().lazyProduct(weighted.leftCols(row.size));
    Add(row.unknown.data(), row.size, normal.topLeftCorner(row.size, row.size));
  }
}

void NormalEquations::AddBars(const Network& network, const UnknownIndex& index) {
  for (const NetworkScaleBar& bar : network.scale_bars) {
    if (!bar.used) continue;
    const BarRow row = LineariseBar(network, index, bar);
    const double weight = 1 / (bar.sigma_mm * bar.sigma_mm);
    const auto design = row.design.leftCols(row.size);
    num_prior += 1;
    bar_squares += weight * std::pow(bar.length_mm - row.length_mm, 2);
    Add(row.unknown.data(), row.size, weight * design.transpose() * design);
  }
  weighted_squares += bar_squares;
}

void NormalEquations::AddPointPriors(const Network& network, const UnknownIndex& index) {
  std::vector<bool> in_block(network.points.size(), false);
  for (const int p : network.prior_block.points) in_block[p] = true;
  for (std::size_t i = 0; i < network.points.size(); ++i) {
    const NetworkPoint& p = network.points[i];
    if (!p.is_observed()) continue;
    num_prior += 3;
    if (in_block[i]) continue;
    const Eigen::Matrix3d weight = p.prior_cov_mm2.inverse();
    const Eigen::Vector3d residual = p.prior_mm - p.position_mm;
    const int first = index.point[i];
    const std::array<int, 3> unknown = {first, first + 1, first + 2};
    Add(unknown.data(), 3, weight);
    point_squares += residual.dot(weight * residual);
  }
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
  point_squares += residual.dot(block.weight_per_mm2 * residual);
  weighted_squares += point_squares;
}

void NormalEquations::AddCameraPriors(const Network& network, const UnknownIndex& index) {
  for (std::size_t c = 0; c < network.cameras.size(); ++c) {
    const NetworkCamera& camera = network.cameras[c];
    const CameraVector values = camera.values();
    for (int k = 0; k < kNumCameraUnknowns; ++k) {
      const int u = index.camera[c][k];
      if (u < 0 || !(camera.prior_sigma[k] > 0)) continue;
      const double sigma = camera.prior_sigma[k];
      reduced(elimination_.place[u], elimination_.place[u]) += 1 / (sigma * sigma);
      num_prior += 1;
      weighted_squares += std::pow((camera.start[k] - values[k]) / sigma, 2);
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
      const double sigma = window.prior_sigma[k];
      reduced(elimination_.place[u], elimination_.place[u]) += 1 / (sigma * sigma);
      num_prior += 1;
      weighted_squares += std::pow(change[k] / sigma, 2);
    }
  }
}

void NormalEquations::Eliminate(const Network& network, const UnknownIndex& index) {
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
    block.inverse = scale.asDiagonal() * factor.solve(Eigen::MatrixXd::Identity(size, size)) *
                    scale.asDiagonal();
    block.y.noalias() = block.inverse * block.coupling;
    for (std::size_t j = 0; j < block.columns.size(); ++j) {
      const Eigen::Index column = static_cast<Eigen::Index>(j);
      for (Eigen::Index i = column; i < block.y.cols(); ++i) {
        reduced(block.columns[static_cast<std::size_t>(i)], block.columns[j]) -=
            block.y.col(i).dot(block.coupling.col(column));
      }
    }
  }
}

}  // namespace videogrammetry
