#include "videogrammetry/adjustment/dispersion.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>

#include "videogrammetry/adjustment/observation_model.h"
#include "videogrammetry/core/errors.h"

namespace videogrammetry {
namespace {

// Below this share of its unit diagonal a pivot is rounding: about 1e4 times
// the double's epsilon, and far under what a solvable network shows (1e-9).
constexpr double kRankTolerance = 1e-12;

}  // namespace

Dispersion::Dispersion(const Network& network) : network_(network), index_(network) {
  normal_ = Eigen::MatrixXd::Zero(index_.num_reduced, index_.num_reduced);
  normal_by_point_ = Eigen::MatrixXd::Zero(index_.num_reduced, 3 * index_.num_points);
  normal_point_.assign(static_cast<std::size_t>(index_.num_points), Eigen::Matrix3d::Zero());
  Accumulate();
  AddPriors();
  Factor();
  AccountForPriors();
}

Dispersion::Row Dispersion::Linearise(int image_index, int point) const {
  const NetworkImage& image = network_.images[image_index];
  const NetworkCamera& camera = network_.cameras[image.camera];
  const Rigid3* outer = image.outer < 0 ? nullptr : &network_.poses[image.outer].transform;
  ImagePointJacobians j;
  Row row;
  const auto pixel = PredictImagePoint(camera.camera, outer, network_.poses[image.inner].transform,
                                       network_.points[point].mark(), &j);
  if (!pixel) return row;
  row.valid = true;
  row.pixel = *pixel;
  row.by_point = j.by_point;
  for (int k = 0; k < kNumInterior; ++k) {
    if (index_.interior[image.camera][k] < 0) continue;
    row.by_reduced.col(row.size) = j.by_interior.col(k);
    row.unknown[row.size++] = index_.interior[image.camera][k];
  }
  auto add_pose = [&](int pose, const Eigen::Matrix<double, 2, 6>& by_pose) {
    if (pose < 0 || index_.pose[pose] < 0) return;
    for (int k = 0; k < 6; ++k) {
      row.by_reduced.col(row.size) = by_pose.col(k);
      row.unknown[row.size++] = index_.pose[pose] + k;
    }
  };
  add_pose(image.outer, j.by_outer);
  add_pose(image.inner, j.by_inner);
  return row;
}

void Dispersion::Accumulate() {
  for (const NetworkObservation& o : network_.observations) {
    if (!o.used) continue;
    const Row row = Linearise(o.image, o.point);
    if (!row.valid) continue;
    const Eigen::Matrix2d weight = network_.TotalCov(o).inverse();
    const Eigen::Vector2d residual = o.xy_px - row.pixel;
    num_observations_ += 2;
    weighted_squares_ += residual.dot(weight * residual);
    const Eigen::Matrix<double, 2, 22> weighted = weight * row.by_reduced;
    const int point = index_.point[o.point];
    for (int b = 0; b < row.size; ++b) {
      for (int a = 0; a <= b; ++a) {
        const double value = row.by_reduced.col(a).dot(weighted.col(b));
        // Lower triangle; an unknown's place says which of the two it is.
        normal_(std::max(row.unknown[a], row.unknown[b]),
                std::min(row.unknown[a], row.unknown[b])) += value;
      }
      if (point >= 0) {
        normal_by_point_.row(row.unknown[b]).segment<3>(3 * point) +=
            weighted.col(b).transpose() * row.by_point;
      }
    }
    if (point >= 0) {
      normal_point_[point] += row.by_point.transpose() * weight * row.by_point;
    }
  }
}

void Dispersion::AddPriors() {
  for (std::size_t i = 0; i < network_.points.size(); ++i) {
    const NetworkPoint& p = network_.points[i];
    if (p.kind != PointKind::kWeighted) continue;
    const Eigen::Matrix3d weight = p.prior_cov_mm2.inverse();
    const Eigen::Vector3d residual = p.prior_mm - p.position_mm;
    normal_point_[index_.point[i]] += weight;
    num_prior_ += 3;
    point_squares_ += residual.dot(weight * residual);
  }
  weighted_squares_ += point_squares_;
  for (std::size_t c = 0; c < network_.cameras.size(); ++c) {
    const NetworkCamera& camera = network_.cameras[c];
    for (int k = 0; k < kNumInterior; ++k) {
      const int u = index_.interior[c][k];
      if (u < 0 || !(camera.prior_sigma[k] > 0)) continue;
      const double sigma = camera.prior_sigma[k];
      normal_(u, u) += 1 / (sigma * sigma);
      num_prior_ += 1;
      weighted_squares_ += std::pow((camera.start[k] - camera.camera.interior[k]) / sigma, 2);
    }
  }
}

void Dispersion::Factor() {
  const Eigen::Index u = index_.num_reduced;
  y_.resize(u, 3 * index_.num_points);
  for (int p = 0; p < index_.num_points; ++p) {
    const Eigen::Matrix3d& n = normal_point_[p];
    const double scale = std::pow(std::max(n.trace() / 3, 1e-300), 3);
    if (!(n.determinant() > kRankTolerance * scale)) {
      const auto found = std::find(index_.point.begin(), index_.point.end(), p);
      throw AdjustmentError("point " +
                            std::to_string(network_.points[found - index_.point.begin()].id) +
                            " is not determined: too few pictures see it, or all along one line");
    }
    inverse_point_.push_back(n.inverse());
    y_.middleCols<3>(3 * p).noalias() = normal_by_point_.middleCols<3>(3 * p) * inverse_point_[p];
  }
  Eigen::MatrixXd reduced = normal_.selfadjointView<Eigen::Lower>();
  if (index_.num_points > 0) reduced.noalias() -= y_ * normal_by_point_.transpose();
  const Eigen::VectorXd diagonal = normal_.diagonal();
  if (u > 0 && !(diagonal.minCoeff() > 0)) ThrowRankDefect(reduced);
  const Eigen::VectorXd scale = diagonal.cwiseSqrt().cwiseInverse();
  reduced = scale.asDiagonal() * reduced * scale.asDiagonal();
  const Eigen::LLT<Eigen::MatrixXd> factor(reduced);
  if (factor.info() != Eigen::Success ||
      (u > 0 && factor.matrixLLT().diagonal().cwiseAbs2().minCoeff() < kRankTolerance)) {
    ThrowRankDefect(reduced);
  }
  cov_ = factor.solve(Eigen::MatrixXd::Identity(u, u));
  cov_ = scale.asDiagonal() * cov_ * scale.asDiagonal();
  cov_ = 0.5 * (cov_ + cov_.transpose().eval());
  cov_by_point_.noalias() = -(cov_ * y_);
}

void Dispersion::AccountForPriors() {
  for (std::size_t i = 0; i < network_.points.size(); ++i) {
    const NetworkPoint& p = network_.points[i];
    if (p.kind != PointKind::kWeighted) continue;
    point_redundancy_ += 3.0 - (CovPoint(static_cast<int>(i)) * p.prior_cov_mm2.inverse()).trace();
  }
}

void Dispersion::ThrowRankDefect(const Eigen::MatrixXd& normal) const {
  std::ostringstream names;
  int count = 0;
  auto add = [&](int unknown) {
    if (count++ < 8) names << (count > 1 ? ", " : "") << UnknownName(network_, index_, unknown);
  };
  const Eigen::VectorXd diagonal = normal_.diagonal();
  bool empty = false;
  for (int i = 0; i < index_.num_reduced; ++i) {
    if (!(diagonal[i] > 0)) {
      empty = true;
      add(i);
    }
  }
  if (!empty) {
    // The eigenvector of the smallest eigenvalue shows what can move freely.
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(normal);
    const Eigen::VectorXd v = eigen.eigenvectors().col(0).cwiseAbs();
    std::vector<int> order(static_cast<std::size_t>(v.size()));
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(), [&](int a, int b) { return v[a] > v[b]; });
    for (int i : order) {
      if (v[i] > 0.2 * v.maxCoeff()) add(i);
    }
  }
  if (count > 8) names << " and " << count - 8 << " more";
  throw AdjustmentError("the observations do not determine all unknowns (rank defect); free to " +
                        std::string("move: ") + names.str());
}

Eigen::Matrix3d Dispersion::CovPoint(int point) const {
  const int p = index_.point[point];
  if (p < 0) return Eigen::Matrix3d::Zero();
  const auto y = y_.middleCols<3>(3 * p);
  return inverse_point_[p] - y.transpose() * cov_by_point_.middleCols<3>(3 * p);
}

Eigen::MatrixXd Dispersion::FullCovariance() const {
  const Eigen::Index u = index_.num_reduced, p3 = 3 * index_.num_points;
  Eigen::MatrixXd full(u + p3, u + p3);
  full.topLeftCorner(u, u) = cov_;
  full.topRightCorner(u, p3) = cov_by_point_;
  full.bottomLeftCorner(p3, u) = cov_by_point_.transpose();
  full.bottomRightCorner(p3, p3).noalias() = -(y_.transpose() * cov_by_point_);
  for (int p = 0; p < index_.num_points; ++p) {
    full.block<3, 3>(u + 3 * p, u + 3 * p) += inverse_point_[p];
  }
  return full;
}

void Dispersion::ApplyCondition(const std::vector<int>& which, const Eigen::VectorXd& change,
                                Network* network) const {
  const Eigen::Index n = static_cast<Eigen::Index>(which.size());
  Eigen::MatrixXd columns(cov_.rows(), n), block(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    columns.col(i) = cov_.col(which[static_cast<std::size_t>(i)]);
  for (Eigen::Index i = 0; i < n; ++i)
    block.row(i) = columns.row(which[static_cast<std::size_t>(i)]);
  // Unit diagonal: A1 and A3 differ by twelve powers of ten.
  const Eigen::VectorXd scale = block.diagonal().cwiseSqrt().cwiseInverse();
  block = scale.asDiagonal() * block * scale.asDiagonal();
  const Eigen::VectorXd factor = scale.cwiseProduct(block.ldlt().solve(scale.cwiseProduct(change)));
  const Eigen::VectorXd step = columns * factor;
  Eigen::MatrixXd by_point(n, cov_by_point_.cols());
  for (Eigen::Index i = 0; i < n; ++i) {
    by_point.row(i) = cov_by_point_.row(which[static_cast<std::size_t>(i)]);
  }
  const Eigen::VectorXd point_step = by_point.transpose() * factor;
  for (std::size_t c = 0; c < index_.interior.size(); ++c) {
    for (int k = 0; k < kNumInterior; ++k) {
      const int u = index_.interior[c][k];
      if (u >= 0) network->cameras[c].camera.interior[k] += step[u];
    }
  }
  for (std::size_t p = 0; p < index_.pose.size(); ++p) {
    if (index_.pose[p] < 0) continue;
    Rigid3& pose = network->poses[p].transform;
    pose.rotation = RotationFromVector(step.segment<3>(index_.pose[p])) * pose.rotation;
    pose.translation_mm += step.segment<3>(index_.pose[p] + 3);
  }
  for (std::size_t p = 0; p < index_.point.size(); ++p) {
    if (index_.point[p] < 0) continue;
    network->points[p].position_mm += point_step.segment<3>(3 * index_.point[p]);
  }
}

Eigen::Matrix2d Dispersion::CovOfPrediction(const Row& row, int point) const {
  Eigen::Matrix<double, 22, 22> q;
  for (int b = 0; b < row.size; ++b) {
    for (int a = 0; a < row.size; ++a) q(a, b) = cov_(row.unknown[a], row.unknown[b]);
  }
  const auto a = row.by_reduced.leftCols(row.size);
  Eigen::Matrix2d cov = a * q.topLeftCorner(row.size, row.size) * a.transpose();
  const int p = index_.point[point];
  if (p < 0) return cov;
  Eigen::Matrix<double, 22, 3> q_by_point;
  for (int i = 0; i < row.size; ++i) {
    q_by_point.row(i) = cov_by_point_.row(row.unknown[i]).segment<3>(3 * p);
  }
  const Eigen::Matrix2d cross = a * q_by_point.topRows(row.size) * row.by_point.transpose();
  cov += cross + cross.transpose() + row.by_point * CovPoint(point) * row.by_point.transpose();
  return cov;
}

std::vector<ObservationStatistics> Dispersion::Statistics() const {
  std::vector<ObservationStatistics> all(network_.observations.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    const NetworkObservation& o = network_.observations[i];
    const Row row = Linearise(o.image, o.point);
    if (!row.valid) continue;
    ObservationStatistics& s = all[i];
    s.valid = true;
    s.residual_px = o.xy_px - row.pixel;
    const Eigen::Matrix2d total = network_.TotalCov(o), weight = total.inverse();
    const Eigen::Matrix2d adjusted = CovOfPrediction(row, o.point);
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
    // A coordinate that nothing else checks (redundancy 0) cannot be tested.
    for (int k = 0; k < 2; ++k) {
      s.normalised[k] = s.redundancy[k] > 1e-6 ? pv[k] / std::sqrt(var[k]) : 0.0;
    }
  }
  return all;
}

std::optional<Dispersion::Prediction> Dispersion::Predict(int image, int point) const {
  const Row row = Linearise(image, point);
  if (!row.valid) return std::nullopt;
  return Prediction{row.pixel, CovOfPrediction(row, point)};
}

}  // namespace videogrammetry
