#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <stdexcept>
#include <string>

#include "videogrammetry/adjustment/datum.h"
#include "videogrammetry/adjustment/network.h"

namespace videogrammetry {
namespace {

// A free network's covariance has pivots of 1e-13 and less (of a unit diagonal)
// in its datum's directions, rounding; what is known has more than 1e-9.
constexpr double kSingularPivot = 1e-10;

bool IsRegular(const Eigen::MatrixXd& cov) {
  if (!(cov.diagonal().minCoeff() > 0)) return false;
  const Eigen::VectorXd scale = cov.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::LLT<Eigen::MatrixXd> factor(scale.asDiagonal() * cov * scale.asDiagonal());
  return factor.info() == Eigen::Success &&
         factor.matrixLLT().diagonal().cwiseAbs2().minCoeff() > kSingularPivot;
}

/// Adds a variance along the first `count` Helmert directions at `mean_mm`: a
/// shift then moves every point by the average variance.
Eigen::MatrixXd WithDatumVariance(const Eigen::MatrixXd& cov, const Eigen::VectorXd& mean_mm,
                                  int count) {
  const Eigen::Index k = mean_mm.size() / 3;
  Eigen::MatrixXd directions(3 * k, count);
  const Eigen::Vector3d centre =
      Eigen::Map<const Eigen::Matrix3Xd>(mean_mm.data(), 3, k).rowwise().mean();
  for (Eigen::Index i = 0; i < k; ++i) {
    directions.middleRows<3>(3 * i) =
        HelmertOfPoint(mean_mm.segment<3>(3 * i) - centre).leftCols(count);
  }
  const Eigen::MatrixXd axes = Eigen::HouseholderQR<Eigen::MatrixXd>(directions).householderQ() *
                               Eigen::MatrixXd::Identity(3 * k, count);
  return cov + (cov.trace() / 3) * (axes * axes.transpose());
}

}  // namespace

bool PriorBlock::contains(int point) const {
  return std::find(points.begin(), points.end(), point) != points.end();
}

void PriorBlock::Update(const std::vector<NetworkPoint>& all) {
  std::vector<bool> in(points.size());
  std::vector<Eigen::Index> rows;
  for (std::size_t i = 0; i < points.size(); ++i) {
    in[i] = all[static_cast<std::size_t>(points[i])].is_observed();
    for (Eigen::Index k = 0; in[i] && k < 3; ++k) {
      rows.push_back(3 * static_cast<Eigen::Index>(i) + k);
    }
  }
  if (in == in_weight && weight_per_mm2.rows() == cov_mm2.rows()) return;
  in_weight = in;
  const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
  Eigen::MatrixXd cov = cov_mm2(rows, rows);
  Eigen::MatrixXd whiten = Eigen::MatrixXd::Identity(n, n);
  if (n > 0) cov.llt().matrixL().solveInPlace(whiten);
  weight_per_mm2.setZero(cov_mm2.rows(), cov_mm2.rows());
  whiten_per_mm.setZero(cov_mm2.rows(), cov_mm2.rows());
  weight_per_mm2(rows, rows) = whiten.transpose() * whiten;
  whiten_per_mm(rows, rows) = whiten;
}

void Network::SetPriorBlock(const std::vector<int>& rows, const Eigen::VectorXd& mean_mm,
                            const Eigen::MatrixXd& cov_mm2) {
  const Eigen::Index size = 3 * static_cast<Eigen::Index>(rows.size());
  auto require = [](bool condition, const std::string& what) {
    if (!condition) throw std::invalid_argument("prior of points: " + what);
  };
  require(mean_mm.size() == size && cov_mm2.rows() == size && cov_mm2.cols() == size,
          "expected a mean of " + std::to_string(size) +
              " numbers and their square covariance, got " + std::to_string(mean_mm.size()) +
              " and " + std::to_string(cov_mm2.rows()) + " x " + std::to_string(cov_mm2.cols()));
  require(mean_mm.allFinite() && cov_mm2.allFinite(), "a number is not finite");
  std::vector<int> sorted = rows;
  std::sort(sorted.begin(), sorted.end());
  require(std::adjacent_find(sorted.begin(), sorted.end()) == sorted.end(),
          "a point is named twice");
  for (const int p : rows) {
    require(p >= 0 && static_cast<std::size_t>(p) < points.size(), "no such point");
    require(points[static_cast<std::size_t>(p)].kind == PointKind::kWeighted,
            "point " + std::to_string(points[static_cast<std::size_t>(p)].id) +
                " is not a weighted one");
  }
  PriorBlock block;
  block.points = rows;
  block.mean_mm = mean_mm;
  block.cov_mm2 = 0.5 * (cov_mm2 + cov_mm2.transpose());
  const Eigen::MatrixXd given = block.cov_mm2;
  for (const int count : {6, 7}) {
    if (size == 0 || IsRegular(block.cov_mm2)) break;
    require(size > count, "the covariance is singular");
    block.cov_mm2 = WithDatumVariance(given, mean_mm, count);
  }
  require(size == 0 || IsRegular(block.cov_mm2),
          "the covariance is singular beyond shift, rotation and scale of the points");
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Eigen::Index first = 3 * static_cast<Eigen::Index>(i);
    NetworkPoint& p = points[static_cast<std::size_t>(rows[i])];
    p.prior_mm = mean_mm.segment<3>(first);
    p.prior_cov_mm2 = block.cov_mm2.block<3, 3>(first, first);
  }
  prior_block = std::move(block);
  prior_block.Update(points);
}

}  // namespace videogrammetry
