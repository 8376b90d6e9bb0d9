#include "videogrammetry/reconstruction/pose_scores.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cmath>
#include <cstddef>

namespace videogrammetry {
namespace {

constexpr int kPose = 6;
constexpr int kAll = kNumCameraParameters;

template <int N>
using Rows2 = Eigen::Matrix<double, 2, N>;
using Pose = Eigen::Matrix<double, kPose, kPose>;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Derivatives of rotation vector and translation by turn about and shift of the centre:
/// with t = -R c, dt = w x t - R d.
Pose PoseOfMotion(const OrientedCamera& camera) {
  const Eigen::Vector3d& t = camera.cam_from_world.translation_mm;
  Pose by_motion = Pose::Identity();
  by_motion.block<3, 3>(3, 0) << 0, t.z(), -t.y(), -t.z(), 0, t.x(), t.y(), -t.x(), 0;
  by_motion.block<3, 3>(3, 3) = -camera.cam_from_world.rotation;
  return by_motion;
}

/// One camera's sight of a point, in standard deviations.
struct Sight {
  bool seen = false;
  Rows2<3> by_point;
  Rows2<kPose> by_pose;
  Rows2<kAll> by_camera;
  Eigen::Vector2d residual;
};

class Sums {
 public:
  Sums(const Rig& rig, const LookResiduals& residuals)
      : rig_(rig), in_(residuals), cameras_(rig.size()), sights_(rig.size()) {
    const auto c = static_cast<Eigen::Index>(cameras_);
    const auto rank = static_cast<Eigen::Index>(in_.rank);
    const Eigen::Map<const Matrix> factor(in_.factor, kAll * c, rank);
    by_poses_.resize(kPose * c, rank);
    for (Eigen::Index k = 0; k < c; ++k) {
      of_motion_.push_back(PoseOfMotion(rig[static_cast<std::size_t>(k)]));
      by_poses_.middleRows<kPose>(kPose * k) =
          of_motion_.back().inverse() * factor.middleRows<kPose>(kAll * k + kNumInterior);
      free_begin_.push_back(free_.size());
      for (int i = 0; i < kNumInterior; ++i) {
        if (rank > 0 && !factor.row(kAll * k + i).isZero(0.0)) free_.push_back(i);
      }
    }
    free_begin_.push_back(free_.size());
    by_interior_.resize(static_cast<Eigen::Index>(free_.size()), rank);
    for (Eigen::Index k = 0; k < c; ++k) {
      for (std::size_t i = FreeBegin(k); i < FreeBegin(k + 1); ++i) {
        by_interior_.row(static_cast<Eigen::Index>(i)) = factor.row(kAll * k + free_[i]);
      }
    }
  }

  void Look(std::size_t look, double* normal, double* score, double* chi2, double* effect) {
    const auto begin = static_cast<std::size_t>(in_.offsets[look]);
    const auto end = static_cast<std::size_t>(in_.offsets[look + 1]);
    const auto c = static_cast<Eigen::Index>(cameras_);
    const auto n = static_cast<Eigen::Index>(end - begin);
    Matrix sums = Matrix::Zero(kPose * c, kPose * c);
    Eigen::Map<Eigen::VectorXd> g(score, kPose * c);
    const auto free = static_cast<Eigen::Index>(free_.size());
    Matrix crossed = effect != nullptr ? Matrix::Zero(kPose * c, free) : Matrix();
    const bool known = in_.cov_mm2 != nullptr;
    poses_.setZero(known ? 0 : 3 * n, kPose * c);
    interior_.setZero(known || effect == nullptr ? 0 : 3 * n, free);
    double rest = 0.0;
    for (std::size_t p = begin; p < end; ++p) {
      const Eigen::Matrix3d h = See(p);
      for (Eigen::Index k = 0; k < c; ++k) {
        const Sight& sight = sights_[static_cast<std::size_t>(k)];
        if (!sight.seen) continue;
        sums.block<kPose, kPose>(kPose * k, kPose * k).noalias() +=
            sight.by_pose.transpose() * sight.by_pose;
        g.segment<kPose>(kPose * k).noalias() += sight.by_pose.transpose() * sight.residual;
        chi2[k] += sight.residual.squaredNorm();
        if (effect != nullptr) {
          for (std::size_t i = FreeBegin(k); i < FreeBegin(k + 1); ++i) {
            crossed.block<kPose, 1>(kPose * k, static_cast<Eigen::Index>(i)).noalias() +=
                sight.by_pose.transpose() * sight.by_camera.col(free_[i]);
          }
        }
      }
      if (!known) rest += Eliminate(h, 3 * static_cast<Eigen::Index>(p - begin), effect, g);
    }
    if (!known) {
      sums.selfadjointView<Eigen::Lower>().rankUpdate(poses_.transpose(), -1.0);
      if (effect != nullptr) crossed.noalias() -= poses_.transpose() * interior_;
      double total = -rest;
      for (Eigen::Index k = 0; k < c; ++k) total += chi2[k];
      for (Eigen::Index k = 0; k < c; ++k) chi2[k] = total;
    }
    sums = Matrix(sums.selfadjointView<Eigen::Lower>());
    Eigen::Map<Matrix>(normal, kPose * c, kPose * c) = sums;
    if (effect != nullptr) {
      Eigen::Map<Matrix> by(effect, kPose * c, by_poses_.cols());
      by.noalias() = crossed * by_interior_;
      by.noalias() += sums * by_poses_;
    }
  }

 private:
  std::size_t FreeBegin(Eigen::Index camera) const {
    return free_begin_[static_cast<std::size_t>(camera)];
  }

  /// Fills `sights_` with those of a point; returns J'WJ.
  Eigen::Matrix3d See(std::size_t point) {
    const Eigen::Vector3d x(in_.position_mm + 3 * point);
    Eigen::Matrix3d h = Eigen::Matrix3d::Zero();
    for (std::size_t c = 0; c < cameras_; ++c) {
      Sight& sight = sights_[c];
      const std::size_t row = 2 * (point * cameras_ + c);
      const Eigen::Vector2d residual(in_.residual_px[row], in_.residual_px[row + 1]);
      OrientedJacobians j;
      sight.seen = std::isfinite(residual.x()) && std::isfinite(residual.y()) &&
                   ProjectFromWorld(rig_[c], x, &j).has_value();
      if (!sight.seen) continue;
      Eigen::Matrix2d root = Eigen::Matrix2d::Zero();  // W^1/2
      const Eigen::Vector2d variance(in_.variance_px2[row], in_.variance_px2[row + 1]);
      if (in_.cov_mm2 == nullptr) {
        root.diagonal() = variance.cwiseSqrt().cwiseInverse();
      } else {
        using Cov = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
        Eigen::Matrix2d cov =
            j.by_point * Eigen::Map<const Cov>(in_.cov_mm2 + 9 * point) * j.by_point.transpose();
        cov.diagonal() += variance;
        root = Eigen::Matrix2d(cov.llt().matrixL()).inverse();
      }
      sight.residual = root * residual;
      sight.by_point = root * j.by_point;
      sight.by_camera = root * j.by_camera;
      sight.by_pose.noalias() = sight.by_camera.rightCols<kPose>() * of_motion_[c];
      h.noalias() += sight.by_point.transpose() * sight.by_point;
    }
    return h;
  }

  /// What a point takes of poses and cameras, U = L^-1 J'B with L L' = J'J, from `row` on;
  /// returns what it takes of the residuals' squares. Nothing where it is seen too little.
  double Eliminate(const Eigen::Matrix3d& h, Eigen::Index row, const double* effect,
                   Eigen::Map<Eigen::VectorXd>& g) {
    const Eigen::LLT<Eigen::Matrix3d> root(h);
    Eigen::Vector3d v = Eigen::Vector3d::Zero();
    if (root.info() != Eigen::Success) return 0.0;
    const Eigen::Matrix3d inverse = root.matrixL().solve(Eigen::Matrix3d::Identity());
    for (Eigen::Index k = 0; k < static_cast<Eigen::Index>(cameras_); ++k) {
      const Sight& sight = sights_[static_cast<std::size_t>(k)];
      if (!sight.seen) continue;
      const Eigen::Matrix<double, 3, 2> shared = inverse * sight.by_point.transpose();
      poses_.block<3, kPose>(row, kPose * k).noalias() = shared * sight.by_pose;
      v.noalias() += shared * sight.residual;
      if (effect != nullptr) {
        for (std::size_t i = FreeBegin(k); i < FreeBegin(k + 1); ++i) {
          interior_.block<3, 1>(row, static_cast<Eigen::Index>(i)).noalias() =
              shared * sight.by_camera.col(free_[i]);
        }
      }
    }
    g.noalias() -= poses_.middleRows<3>(row).transpose() * v;
    return v.squaredNorm();
  }

  const Rig& rig_;
  const LookResiduals& in_;
  std::size_t cameras_;
  std::vector<Pose> of_motion_;
  std::vector<Sight> sights_;
  Matrix poses_, interior_;  ///< what points take: U, and the same of free interior parameters
  /// Interior parameters that are not held, camera by camera, and where each camera's begin.
  std::vector<int> free_;
  std::vector<std::size_t> free_begin_;
  /// F of the motions (B M^-1 F = A F of the poses), and of the free interior parameters.
  Matrix by_poses_, by_interior_;
};

}  // namespace

PoseScores SumPoseScores(const Rig& rig, const LookResiduals& residuals) {
  const std::size_t looks = residuals.offsets.empty() ? 0 : residuals.offsets.size() - 1;
  const std::size_t c = rig.size(), size = kPose * c;
  PoseScores scores;
  scores.normal.assign(looks * size * size, 0.0);
  scores.score.assign(looks * size, 0.0);
  scores.chi2.assign(looks * c, 0.0);
  scores.by_calibration.assign(looks * size * residuals.rank, 0.0);
  Sums sums(rig, residuals);
  for (std::size_t k = 0; k < looks; ++k) {
    double* effect = scores.by_calibration.data() + k * size * residuals.rank;
    sums.Look(k, scores.normal.data() + k * size * size, scores.score.data() + k * size,
              scores.chi2.data() + k * c, residuals.rank != 0 ? effect : nullptr);
  }
  return scores;
}

}  // namespace videogrammetry
