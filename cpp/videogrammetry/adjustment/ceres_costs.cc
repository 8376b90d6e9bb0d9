#include "videogrammetry/adjustment/ceres_costs.h"

#include <Eigen/Cholesky>
#include <optional>
#include <utility>
#include <vector>

#include "videogrammetry/adjustment/observation_model.h"

namespace videogrammetry {
namespace {

using RowMajorPose = Eigen::Matrix<double, 2, kPoseBlock, Eigen::RowMajor>;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

template <typename Matrix>
Eigen::Map<Matrix> As(double* x) {
  return Eigen::Map<Matrix>(x);
}
template <typename Matrix>
Eigen::Map<const Matrix> As(const double* x) {
  return Eigen::Map<const Matrix>(x);
}

/// R <- exp([w]) R, t <- t + d. The cost functions return derivatives by
/// (w, d) in the first six of the twelve columns, so the derivative of Plus
/// by (w, d) is handed to Ceres as [I6; 0]: only the product of the two counts.
class PoseManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return kPoseBlock; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* sum) const override {
    const Eigen::Map<const Eigen::Vector3d> w(delta), d(delta + 3);
    As<Eigen::Matrix3d>(sum) = RotationFromVector(w) * As<Eigen::Matrix3d>(x);
    As<Eigen::Vector3d>(sum + 9) = As<Eigen::Vector3d>(x + 9) + d;
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    As<Eigen::Matrix<double, kPoseBlock, 6, Eigen::RowMajor>>(jacobian).setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* difference) const override {
    As<Eigen::Vector3d>(difference) =
        VectorFromRotation(As<Eigen::Matrix3d>(y) * As<Eigen::Matrix3d>(x).transpose());
    As<Eigen::Vector3d>(difference + 3) = As<Eigen::Vector3d>(y + 9) - As<Eigen::Vector3d>(x + 9);
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    As<Eigen::Matrix<double, 6, kPoseBlock, Eigen::RowMajor>>(jacobian).setIdentity();
    return true;
  }
};

/// Whitened residual measured - predicted; blocks: camera (in units of
/// CameraScale), [outer pose,] inner pose, point[, window].
class ImagePointCost : public ceres::CostFunction {
 public:
  ImagePointCost(const NetworkCamera& camera, const NetworkObservation& o, const Circle& mark,
                 const Eigen::Matrix2d& cov, bool has_outer, const NetworkInterface* window)
      : camera_(camera.camera),
        corrected_(camera.corrected_residual),
        scale_(CameraScale(camera.camera)),
        mark_(mark),
        xy_px_(o.xy_px),
        velocity_px_(o.velocity_px),
        has_outer_(has_outer) {
    if (window != nullptr) window_ = *window;
    whiten_ = Eigen::Matrix2d::Identity();
    cov.llt().matrixL().solveInPlace(whiten_);
    set_num_residuals(2);
    auto* sizes = mutable_parameter_block_sizes();
    *sizes = has_outer ? std::vector<int32_t>{kNumCameraUnknowns, kPoseBlock, kPoseBlock, 3}
                       : std::vector<int32_t>{kNumCameraUnknowns, kPoseBlock, 3};
    if (window != nullptr) sizes->push_back(kNumInterfaceUnknowns);
  }

  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    Camera camera = camera_;
    const CameraVector values = As<CameraVector>(x[0]).cwiseProduct(scale_);
    camera.interior = values.head<kNumInterior>();
    if (!(camera.f_px() > 0) || !(values[kAspect] > -1)) return false;
    const Rigid3 outer = has_outer_ ? PoseFromBlock(x[1]) : Rigid3();
    const int inner = has_outer_ ? 2 : 1;
    Circle mark = mark_;
    mark.center_mm = As<Eigen::Vector3d>(x[inner + 1]);
    FlatInterface surface;
    Eigen::Matrix<double, 3, 2> normal_by_tilt;
    if (window_) {
      NetworkInterface window = *window_;
      window.set_values(As<Eigen::Vector3d>(x[inner + 2]));
      surface = window.surface(&normal_by_tilt);
    }
    ImagePointJacobians j;
    ImagePointJacobians* wanted = jacobians != nullptr ? &j : nullptr;
    const Sampling sampling{values[kAspect], values[kTimeOffset], velocity_px_};
    auto pixel = PredictImagePoint(camera, has_outer_ ? &outer : nullptr, PoseFromBlock(x[inner]),
                                   mark, sampling, wanted, window_ ? &surface : nullptr);
    if (!pixel) return false;
    if (corrected_) CountFromCorrected(camera, sampling, xy_px_, has_outer_, &*pixel, wanted);
    As<Eigen::Vector2d>(residuals).noalias() = whiten_ * (xy_px_ - *pixel);
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) {
      As<Eigen::Matrix<double, 2, kNumCameraUnknowns, Eigen::RowMajor>>(jacobians[0]) =
          -whiten_ * j.by_camera * scale_.asDiagonal();
    }
    if (has_outer_ && jacobians[1] != nullptr) WritePose(j.by_outer, jacobians[1]);
    if (jacobians[inner] != nullptr) WritePose(j.by_inner, jacobians[inner]);
    if (jacobians[inner + 1] != nullptr) {
      As<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>>(jacobians[inner + 1]) =
          -whiten_ * j.by_point;
    }
    if (window_ && jacobians[inner + 2] != nullptr) {
      Eigen::Matrix<double, 2, kNumInterfaceUnknowns> by_interface;
      by_interface << j.by_normal * normal_by_tilt, j.by_distance;
      As<Eigen::Matrix<double, 2, kNumInterfaceUnknowns, Eigen::RowMajor>>(jacobians[inner + 2]) =
          -whiten_ * by_interface;
    }
    return true;
  }

 private:
  void WritePose(const Eigen::Matrix<double, 2, 6>& by_pose, double* out) const {
    Eigen::Map<RowMajorPose> m(out);
    m.setZero();
    m.leftCols<6>() = -whiten_ * by_pose;
  }

  Camera camera_;
  bool corrected_;
  CameraVector scale_;
  Circle mark_;  // its centre is an unknown
  Eigen::Vector2d xy_px_;
  Eigen::Vector2d velocity_px_;
  Eigen::Matrix2d whiten_;
  bool has_outer_;
  std::optional<NetworkInterface> window_;  // its tilts and distance are unknowns
};

/// Whitened residual of an observed block: W (prior - x).
class PriorCost : public ceres::CostFunction {
 public:
  PriorCost(Eigen::VectorXd prior, Eigen::MatrixXd whiten)
      : prior_(std::move(prior)), whiten_(std::move(whiten)) {
    set_num_residuals(static_cast<int>(prior_.size()));
    mutable_parameter_block_sizes()->push_back(static_cast<int>(prior_.size()));
  }
  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    const Eigen::Index n = prior_.size();
    Eigen::Map<Eigen::VectorXd>(residuals, n).noalias() =
        whiten_ * (prior_ - Eigen::Map<const Eigen::VectorXd>(x[0], n));
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      Eigen::Map<RowMajor>(jacobians[0], n, n) = -whiten_;
    }
    return true;
  }

 private:
  Eigen::VectorXd prior_;
  Eigen::MatrixXd whiten_;
};

/// Residual of a scale bar over its standard deviation; blocks: its two points.
class BarCost : public ceres::SizedCostFunction<1, 3, 3> {
 public:
  explicit BarCost(const NetworkScaleBar& bar) : bar_(bar) {}
  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    const Eigen::Vector3d between = As<Eigen::Vector3d>(x[0]) - As<Eigen::Vector3d>(x[1]);
    const double length_mm = between.norm();
    if (!(length_mm > 0)) return false;
    residuals[0] = (bar_.length_mm - length_mm) / bar_.sigma_mm;
    if (jacobians == nullptr) return true;
    const Eigen::Vector3d along = between / (length_mm * bar_.sigma_mm);
    if (jacobians[0] != nullptr) As<Eigen::Vector3d>(jacobians[0]) = -along;
    if (jacobians[1] != nullptr) As<Eigen::Vector3d>(jacobians[1]) = along;
    return true;
  }

 private:
  NetworkScaleBar bar_;
};

/// Whitened residuals of the prior block: W (mean - x); blocks: its points that take part.
class PriorBlockCost : public ceres::CostFunction {
 public:
  explicit PriorBlockCost(const PriorBlock& block) {
    std::vector<Eigen::Index> rows;
    for (std::size_t i = 0; i < block.points.size(); ++i) {
      if (!block.in_weight[i]) continue;
      for (int k = 0; k < 3; ++k) rows.push_back(3 * static_cast<Eigen::Index>(i) + k);
      mutable_parameter_block_sizes()->push_back(3);
    }
    mean_mm_ = block.mean_mm(rows);
    whiten_ = block.whiten_per_mm(rows, rows);
    set_num_residuals(static_cast<int>(rows.size()));
  }
  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    const Eigen::Index n = mean_mm_.size();
    Eigen::VectorXd residual = mean_mm_;
    for (Eigen::Index i = 0; 3 * i < n; ++i)
      residual.segment<3>(3 * i) -= As<Eigen::Vector3d>(x[i]);
    Eigen::Map<Eigen::VectorXd>(residuals, n).noalias() = whiten_ * residual;
    for (Eigen::Index i = 0; jacobians != nullptr && 3 * i < n; ++i) {
      if (jacobians[i] == nullptr) continue;
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>>(jacobians[i], n, 3) =
          -whiten_.middleCols<3>(3 * i);
    }
    return true;
  }

 private:
  Eigen::VectorXd mean_mm_;
  Eigen::MatrixXd whiten_;
};

}  // namespace

PoseBlock BlockFromPose(const Rigid3& pose) {
  PoseBlock x;
  x << As<Eigen::Matrix<double, 9, 1>>(pose.rotation.data()), pose.translation_mm;
  return x;
}

Rigid3 PoseFromBlock(const double* x) {
  Rigid3 pose;
  pose.rotation = As<Eigen::Matrix3d>(x);
  pose.translation_mm = As<Eigen::Vector3d>(x + 9);
  return pose;
}

std::unique_ptr<ceres::Manifold> MakePoseManifold() { return std::make_unique<PoseManifold>(); }

std::unique_ptr<ceres::CostFunction> MakeImagePointCost(const Network& network,
                                                        const NetworkObservation& o) {
  const NetworkImage& image = network.images[o.image];
  const NetworkCamera& camera = network.cameras[image.camera];
  const NetworkInterface* window =
      camera.interface < 0 ? nullptr : &network.interfaces[camera.interface];
  return std::make_unique<ImagePointCost>(camera, o, network.points[o.point].mark(),
                                          network.TotalCov(o), image.outer >= 0, window);
}

std::unique_ptr<ceres::CostFunction> MakePriorCost(const Eigen::VectorXd& prior,
                                                   const Eigen::MatrixXd& whiten) {
  return std::make_unique<PriorCost>(prior, whiten);
}

std::unique_ptr<ceres::CostFunction> MakeBarCost(const NetworkScaleBar& bar) {
  return std::make_unique<BarCost>(bar);
}

std::unique_ptr<ceres::CostFunction> MakePriorBlockCost(const PriorBlock& block) {
  return std::make_unique<PriorBlockCost>(block);
}

}  // namespace videogrammetry
