#include "videogrammetry/reconstruction/calibration_part.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "videogrammetry/reconstruction/weighted_rows.h"

namespace videogrammetry {
namespace {

constexpr int kLanes = 8;
/// Eigenvalues of the correlations below this are rounding.
constexpr double kZero = 1e-13;

const WeightedRowsKernel& Kernel() {
  static const WeightedRowsKernel kernel = SelectWeightedRows(DetectInstructionSet());
  return kernel;
}

}  // namespace

bool Gain(const Rig& rig, std::span<const Sighting> sightings, const Intersection& point,
          Eigen::Matrix<double, 3, Eigen::Dynamic>* gain) {
  gain->resize(3, static_cast<Eigen::Index>(sightings.size()) * kNumCameraParameters);
  const bool intersected = point.residuals_px.size() == sightings.size();
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    const Sighting& s = sightings[i];
    const OrientedCamera& camera = rig[static_cast<std::size_t>(s.camera)];
    OrientedJacobians jacobians;
    const auto pixel =
        intersected ? ProjectFromWorld(camera, point.position_mm,
                                       Eigen::Vector2d(s.pixel - point.residuals_px[i]), &jacobians)
                    : ProjectFromWorld(camera, point.position_mm, &jacobians);
    if (!pixel) return false;
    const Eigen::Matrix<double, 3, 2> by_pixel =
        -point.cov_mm2 * jacobians.by_point.transpose() * s.cov_px2.inverse();
    gain->middleCols<kNumCameraParameters>(static_cast<Eigen::Index>(i) * kNumCameraParameters)
        .noalias() = by_pixel * jacobians.by_camera;
  }
  return true;
}

Eigen::Matrix<double, 3, 6> FrameEffect(const Eigen::Vector3d& x) {
  Eigen::Matrix<double, 3, 6> effect;
  effect << 0, x.z(), -x.y(), 1, 0, 0, -x.z(), 0, x.x(), 0, 1, 0, x.y(), -x.x(), 0, 0, 0, 1;
  return effect;
}

CalibrationPart::CalibrationPart(const Rig& rig, const RigCovariance& covariance)
    : rig_(rig), given_(covariance.parameters.rows() != 0) {
  if (!given_) return;
  const Eigen::MatrixXd& c = covariance.parameters;
  const Eigen::VectorXd sigma = c.diagonal().cwiseMax(0.0).cwiseSqrt();
  const Eigen::VectorXd inverse = sigma.unaryExpr([](double s) { return s > 0 ? 1 / s : 0.0; });
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(inverse.asDiagonal() * c *
                                                              inverse.asDiagonal());
  const Eigen::VectorXd& values = solver.eigenvalues();
  std::vector<Eigen::Index> kept;
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    if (values[i] > kZero * values.size()) kept.push_back(i);
  }
  rank_ = static_cast<int>(kept.size());
  stride_ = (rank_ + kLanes - 1) / kLanes * kLanes;
  Eigen::MatrixXd factor(c.rows(), rank_);
  for (Eigen::Index k = 0; k < rank_; ++k) {
    const Eigen::Index i = kept[static_cast<std::size_t>(k)];
    factor.col(k) = std::sqrt(values[i]) * sigma.cwiseProduct(solver.eigenvectors().col(i));
  }
  moves_frame_ = covariance.frame_by_parameters.rows() != 0;
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  factor_.assign(static_cast<std::size_t>((c.rows() + 6) * stride_), 0.0);
  Eigen::Map<RowMajor> rows(factor_.data(), c.rows() + 6, stride_);
  rows.topLeftCorner(c.rows(), rank_) = factor;
  if (moves_frame_) {
    rows.bottomLeftCorner(6, rank_) = -covariance.frame_by_parameters * factor;
  }
  uncertain_.resize(rig.size());
  for (Eigen::Index i = 0; i < c.rows(); ++i) {
    if (rows.row(i).isZero(0.0)) continue;
    uncertain_[static_cast<std::size_t>(i / kNumCameraParameters)].push_back(
        static_cast<int>(i % kNumCameraParameters));
  }
}

Eigen::Matrix3d CalibrationPart::Of(std::span<const Sighting> sightings,
                                    const Intersection& point) const {
  // Of a thread, so that no point costs an allocation.
  thread_local Eigen::Matrix<double, 3, Eigen::Dynamic> gain;
  thread_local std::vector<const double*> rows;
  thread_local std::vector<double> weights;
  if (!Gain(rig_, sightings, point, &gain)) {
    return Eigen::Matrix3d::Constant(std::numeric_limits<double>::quiet_NaN());
  }
  const std::size_t most = (sightings.size() * kNumCameraParameters) + 6;
  rows.resize(most);
  weights.resize(3 * most);  // three a row of L
  const double** row = rows.data();
  double* weight = weights.data();
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    const int camera = sightings[i].camera;
    const double* first = factor_.data() + camera * kNumCameraParameters * stride_;
    const double* column = gain.data() + i * 3 * kNumCameraParameters;
    for (const int k : uncertain_[static_cast<std::size_t>(camera)]) {
      *row++ = first + k * stride_;
      weight = std::copy_n(column + 3 * k, 3, weight);
    }
  }
  if (moves_frame_) {
    const Eigen::Matrix<double, 3, 6> effect = FrameEffect(point.position_mm);
    weight = std::copy_n(effect.data(), effect.size(), weight);
    const double* first = factor_.data() + factor_.size() - static_cast<std::size_t>(6 * stride_);
    for (int k = 0; k < 6; ++k) *row++ = first + k * stride_;
  }
  double p[6];
  Kernel()(rows.data(), weights.data(), static_cast<int>(row - rows.data()), stride_, p);
  Eigen::Matrix3d part;
  part << p[0], p[1], p[2], p[1], p[3], p[4], p[2], p[4], p[5];
  return part;
}

}  // namespace videogrammetry
