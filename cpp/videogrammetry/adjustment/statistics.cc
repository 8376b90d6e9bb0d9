#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <array>
#include <cmath>

#include "videogrammetry/adjustment/dispersion.h"
#include "videogrammetry/adjustment/test_distributions.h"

namespace videogrammetry {
namespace {

// A coordinate that nothing else checks (redundancy 0) cannot be tested.
constexpr double kTestable = 1e-6;

std::vector<int> RunOf(const int* unknown, const UnknownRun& run) {
  return {unknown + run.row, unknown + run.row + run.size};
}

}  // namespace

Eigen::MatrixXd Dispersion::CovOfMet(const int* unknown, int size) const {
  Eigen::MatrixXd q(size, size);
  std::array<UnknownRun, ImageRow::kMaxUnknowns> runs;
  const int count = FindRuns(elimination_, unknown, size, runs.data());
  for (int j = 0; j < count; ++j) {
    const UnknownRun& b = runs[j];
    for (int i = 0; i < count; ++i) {
      const UnknownRun& a = runs[i];
      auto part = q.block(a.row, b.row, a.size, b.size);
      if (a.block < 0 && b.block < 0) {
        part = cov_.block(a.place, b.place, a.size, b.size);
      } else if (a.block == b.block) {
        part = block_cov_[a.block].own.block(a.place, b.place, a.size, b.size);
      } else if (a.block >= 0 && b.block < 0 && normal_.blocks[a.block].Column(b.place) >= 0) {
        const int column = normal_.blocks[a.block].Column(b.place);
        part = block_cov_[a.block].by_columns.block(a.place, column, a.size, b.size);
        q.block(b.row, a.row, b.size, a.size) = part.transpose();
      } else if (a.block >= 0) {  // not met by any observation
        part = Covariance(RunOf(unknown, a), RunOf(unknown, b));
        q.block(b.row, a.row, b.size, a.size) = part.transpose();
      }
    }
  }
  return q;
}

std::vector<ObservationStatistics> Dispersion::Statistics() const {
  std::vector<ObservationStatistics> all(network_.observations.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    const NetworkObservation& o = network_.observations[i];
    const ImageRow row = LineariseObservation(network_, index_, o);
    if (!row.valid) continue;
    ObservationStatistics& s = all[i];
    s.valid = true;
    s.residual_px = o.xy_px - row.pixel;
    const Eigen::Matrix2d total = network_.TotalCov(o), weight = total.inverse();
    const auto design = row.design.leftCols(row.size);
    const Eigen::Matrix2d adjusted =
        design.lazyProduct(CovOfMet(row.unknown.data(), row.size)).eval() * design.transpose();
    s.weighted_square = s.residual_px.dot(weight * s.residual_px);
    if (!o.used) {
      s.normalised = s.residual_px.array() / (total + adjusted).diagonal().array().sqrt();
      s.redundancy.setOnes();
      continue;
    }
    const Eigen::Matrix2d q_vv = total - adjusted;
    s.redundancy = (q_vv * weight).diagonal();
    const Eigen::Vector2d pv = weight * s.residual_px;
    const Eigen::Vector2d var = (weight * q_vv * weight).diagonal();
    for (int k = 0; k < 2; ++k) {
      s.normalised[k] = s.redundancy[k] > kTestable ? pv[k] / std::sqrt(var[k]) : 0.0;
    }
  }
  return all;
}

std::vector<BarStatistics> Dispersion::StatisticsOfBars() const {
  std::vector<BarStatistics> all;
  for (const NetworkScaleBar& bar : network_.scale_bars) {
    const BarRow row = LineariseBar(network_, index_, bar);
    const auto design = row.design.leftCols(row.size);
    const double adjusted =
        (design * CovOfMet(row.unknown.data(), row.size) * design.transpose())(0, 0);
    const double total = bar.sigma_mm * bar.sigma_mm;
    BarStatistics s;
    s.residual_mm = bar.length_mm - row.length_mm;
    s.redundancy = bar.used ? 1 - adjusted / total : 1.0;
    const double variance = bar.used ? total - adjusted : total + adjusted;
    if (s.redundancy > kTestable) s.normalised = s.residual_mm / std::sqrt(variance);
    all.push_back(s);
  }
  return all;
}

void Dispersion::OfWeightedPoint(int point, PointStatistics* s) const {
  const NetworkPoint& p = network_.points[point];
  const Eigen::Matrix3d adjusted = CovPoint(point), weight = p.prior_cov_mm2.inverse();
  s->valid = true;
  s->residual_mm = p.prior_mm - p.position_mm;
  if (!p.prior_used) {
    const Eigen::Matrix3d total = p.prior_cov_mm2 + adjusted;
    s->redundancy = 3.0;
    s->normalised = s->residual_mm.array() / total.diagonal().array().sqrt();
    s->test = EquivalentDeviate(s->residual_mm.dot(total.ldlt().solve(s->residual_mm)));
    return;
  }
  const Eigen::Vector3d u = weight * s->residual_mm;
  const Eigen::Matrix3d q_u = weight - weight * adjusted * weight;
  s->redundancy = 3.0 - (adjusted * weight).trace();
  if (s->redundancy < 3 * kTestable) return;
  for (int k = 0; k < 3; ++k) {
    if (q_u(k, k) > kTestable * weight(k, k)) s->normalised[k] = u[k] / std::sqrt(q_u(k, k));
  }
  s->test = EquivalentDeviate(QuadraticForm(u, q_u, weight, kTestable));
}

void Dispersion::OfPriorBlock(std::vector<PointStatistics>* all) const {
  const PriorBlock& block = network_.prior_block;
  const Eigen::Index n = static_cast<Eigen::Index>(block.points.size());
  if (n == 0) return;
  const Eigen::MatrixXd& weight = block.weight_per_mm2;
  Eigen::VectorXd residual(3 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    residual.segment<3>(3 * i) =
        block.mean_mm.segment<3>(3 * i) - network_.points[block.points[i]].position_mm;
  }
  Eigen::MatrixXd q = CovPoints(block.points);
  for (Eigen::Index i = 0; i < n; ++i) {  // starved points: weight 0, and 0 * NaN is NaN
    if (!network_.points[block.points[i]].starved) continue;
    q.middleRows<3>(3 * i).setZero();
    q.middleCols<3>(3 * i).setZero();
  }
  const Eigen::VectorXd u = weight * residual;
  const Eigen::MatrixXd wq = weight * q;
  for (Eigen::Index i = 0; i < n; ++i) {
    const NetworkPoint& p = network_.points[block.points[i]];
    if (p.starved) continue;
    PointStatistics& s = (*all)[block.points[i]];
    s.valid = true;
    s.residual_mm = residual.segment<3>(3 * i);
    const Eigen::Matrix3d own = weight.block<3, 3>(3 * i, 3 * i);
    if (p.prior_used) {
      const Eigen::Matrix3d q_u = own - wq.middleRows<3>(3 * i) * weight.middleCols<3>(3 * i);
      s.redundancy = 3.0 - wq.block<3, 3>(3 * i, 3 * i).trace();
      for (int k = 0; k < 3; ++k) {
        if (q_u(k, k) > kTestable * own(k, k))
          s.normalised[k] = u[3 * i + k] / std::sqrt(q_u(k, k));
      }
      s.test = EquivalentDeviate(QuadraticForm(u.segment<3>(3 * i), q_u, own, kTestable));
      continue;
    }
    // A set-aside point against what the others predict of it: its prior given
    // theirs, mean - K (their residuals) with K = C_po P_oo.
    Eigen::MatrixXd b = -(block.cov_mm2.middleRows<3>(3 * i) * weight);
    const Eigen::Vector3d difference = s.residual_mm + b * residual;
    const Eigen::Matrix3d conditional =
        block.cov_mm2.block<3, 3>(3 * i, 3 * i) + b * block.cov_mm2.middleCols<3>(3 * i);
    b.middleCols<3>(3 * i) += Eigen::Matrix3d::Identity();
    const Eigen::Matrix3d total = conditional + b * q * b.transpose();
    s.redundancy = 3.0;
    s.normalised = difference.array() / total.diagonal().array().sqrt();
    s.test = EquivalentDeviate(difference.dot(total.ldlt().solve(difference)));
  }
}

std::vector<PointStatistics> Dispersion::StatisticsOfPoints() const {
  std::vector<PointStatistics> all(network_.points.size());
  std::vector<bool> in_block(all.size(), false);
  for (const int p : network_.prior_block.points) in_block[p] = true;
  OfPriorBlock(&all);
  for (int i = 0; i < static_cast<int>(all.size()); ++i) {
    const NetworkPoint& p = network_.points[i];
    if (p.kind == PointKind::kWeighted && !p.starved && !in_block[i]) OfWeightedPoint(i, &all[i]);
  }
  return all;
}

std::optional<Dispersion::Prediction> Dispersion::Predict(int image, int point) const {
  const ImageRow row = LineariseImagePoint(network_, index_, image, point, Eigen::Vector2d::Zero());
  if (!row.valid) return std::nullopt;
  const auto design = row.design.leftCols(row.size);
  const std::vector<int> met(row.unknown.begin(), row.unknown.begin() + row.size);
  return Prediction{row.pixel, design * CovOfMet(met.data(), row.size) * design.transpose()};
}

}  // namespace videogrammetry
