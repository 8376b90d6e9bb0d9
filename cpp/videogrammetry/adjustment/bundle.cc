#include "videogrammetry/adjustment/bundle.h"

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <memory>

#include "videogrammetry/adjustment/datum.h"
#include "videogrammetry/adjustment/elimination.h"
#include "videogrammetry/adjustment/gauss_newton.h"
#include "videogrammetry/adjustment/observation_model.h"
#include "videogrammetry/core/thread_pool.h"

namespace videogrammetry {
namespace {

using RowMajorPose = Eigen::Matrix<double, 2, 12, Eigen::RowMajor>;
constexpr int kPoseSize = 12;  // rotation matrix, column by column, then the shift

template <typename Matrix>
Eigen::Map<Matrix> As(double* x) {
  return Eigen::Map<Matrix>(x);
}
template <typename Matrix>
Eigen::Map<const Matrix> As(const double* x) {
  return Eigen::Map<const Matrix>(x);
}

Rigid3 PoseFrom(const double* x) {
  Rigid3 pose;
  pose.rotation = As<Eigen::Matrix3d>(x);
  pose.translation_mm = As<Eigen::Vector3d>(x + 9);
  return pose;
}

/// R <- exp([w]) R, t <- t + d. The cost functions return derivatives by
/// (w, d) in the first six of the twelve columns, so the derivative of Plus
/// by (w, d) is handed to Ceres as [I6; 0]: only the product of the two counts.
class PoseManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return kPoseSize; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* sum) const override {
    const Eigen::Map<const Eigen::Vector3d> w(delta), d(delta + 3);
    As<Eigen::Matrix3d>(sum) = RotationFromVector(w) * As<Eigen::Matrix3d>(x);
    As<Eigen::Vector3d>(sum + 9) = As<Eigen::Vector3d>(x + 9) + d;
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    As<Eigen::Matrix<double, kPoseSize, 6, Eigen::RowMajor>>(jacobian).setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* difference) const override {
    As<Eigen::Vector3d>(difference) =
        VectorFromRotation(As<Eigen::Matrix3d>(y) * As<Eigen::Matrix3d>(x).transpose());
    As<Eigen::Vector3d>(difference + 3) = As<Eigen::Vector3d>(y + 9) - As<Eigen::Vector3d>(x + 9);
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    As<Eigen::Matrix<double, 6, kPoseSize, Eigen::RowMajor>>(jacobian).setIdentity();
    return true;
  }
};

/// Whitened residual measured - predicted; blocks: camera (in units of
/// CameraScale), [outer pose,] inner pose, point.
class ImagePointCost : public ceres::CostFunction {
 public:
  ImagePointCost(const Camera& camera, const NetworkObservation& o, const Circle& mark,
                 const Eigen::Matrix2d& cov, bool has_outer)
      : camera_(camera),
        scale_(CameraScale(camera)),
        mark_(mark),
        xy_px_(o.xy_px),
        velocity_px_(o.velocity_px),
        has_outer_(has_outer) {
    whiten_ = Eigen::Matrix2d::Identity();
    cov.llt().matrixL().solveInPlace(whiten_);
    set_num_residuals(2);
    auto* sizes = mutable_parameter_block_sizes();
    *sizes = has_outer ? std::vector<int32_t>{kNumCameraUnknowns, kPoseSize, kPoseSize, 3}
                       : std::vector<int32_t>{kNumCameraUnknowns, kPoseSize, 3};
  }

  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    Camera camera = camera_;
    const CameraVector values = As<CameraVector>(x[0]).cwiseProduct(scale_);
    camera.interior = values.head<kNumInterior>();
    if (!(camera.f_px() > 0) || !(values[kAspect] > -1)) return false;
    const Rigid3 outer = has_outer_ ? PoseFrom(x[1]) : Rigid3();
    const int inner = has_outer_ ? 2 : 1;
    Circle mark = mark_;
    mark.center_mm = As<Eigen::Vector3d>(x[inner + 1]);
    ImagePointJacobians j;
    const auto pixel = PredictImagePoint(camera, has_outer_ ? &outer : nullptr, PoseFrom(x[inner]),
                                         mark, {values[kAspect], values[kTimeOffset], velocity_px_},
                                         jacobians != nullptr ? &j : nullptr);
    if (!pixel) return false;
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
    return true;
  }

 private:
  void WritePose(const Eigen::Matrix<double, 2, 6>& by_pose, double* out) const {
    Eigen::Map<RowMajorPose> m(out);
    m.setZero();
    m.leftCols<6>() = -whiten_ * by_pose;
  }

  Camera camera_;
  CameraVector scale_;
  Circle mark_;  // its centre is an unknown
  Eigen::Vector2d xy_px_;
  Eigen::Vector2d velocity_px_;
  Eigen::Matrix2d whiten_;
  bool has_outer_;
};

/// Whitened residual of an observed block: W (prior - x).
template <int N>
class PriorCost : public ceres::SizedCostFunction<N, N> {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;
  using Matrix = Eigen::Matrix<double, N, N>;
  PriorCost(const Vector& prior, const Matrix& whiten) : prior_(prior), whiten_(whiten) {}
  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    As<Vector>(residuals).noalias() = whiten_ * (prior_ - As<Vector>(x[0]));
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      As<Eigen::Matrix<double, N, N, Eigen::RowMajor>>(jacobians[0]) = -whiten_;
    }
    return true;
  }

 private:
  Vector prior_;
  Matrix whiten_;
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

/// The network's numbers in the blocks that Ceres works on.
struct Blocks {
  std::vector<CameraVector> camera;
  std::vector<Eigen::Matrix<double, kPoseSize, 1>> pose;
  std::vector<Eigen::Vector3d> point;

  explicit Blocks(const Network& network) {
    for (const NetworkCamera& c : network.cameras) {
      camera.push_back(c.values().cwiseQuotient(CameraScale(c.camera)));
    }
    for (const NetworkPose& p : network.poses) {
      pose.emplace_back();
      pose.back() << As<Eigen::Matrix<double, 9, 1>>(p.transform.rotation.data()),
          p.transform.translation_mm;
    }
    for (const NetworkPoint& p : network.points) point.push_back(p.position_mm);
  }

  void WriteTo(Network* network) const {
    for (std::size_t i = 0; i < camera.size(); ++i) {
      NetworkCamera& c = network->cameras[i];
      c.set_values(camera[i].cwiseProduct(CameraScale(c.camera)));
    }
    for (std::size_t i = 0; i < pose.size(); ++i) {
      if (!network->poses[i].free) continue;
      Rigid3 transform = PoseFrom(pose[i].data());
      transform.rotation = NearestRotation(transform.rotation);  // rounding of many small turns
      network->poses[i].transform = transform;
    }
    for (std::size_t i = 0; i < point.size(); ++i) network->points[i].position_mm = point[i];
  }
};

void AddImagePoints(Network* network, Blocks* blocks, ceres::LossFunction* loss,
                    ceres::Problem* problem) {
  for (NetworkObservation& o : network->observations) {
    if (!o.used) continue;
    const NetworkImage& image = network->images[o.image];
    const NetworkCamera& camera = network->cameras[image.camera];
    const Circle mark = network->points[o.point].mark();
    std::vector<double*> x = {blocks->camera[image.camera].data()};
    if (image.outer >= 0) x.push_back(blocks->pose[image.outer].data());
    x.push_back(blocks->pose[image.inner].data());
    x.push_back(blocks->point[o.point].data());
    problem->AddResidualBlock(
        new ImagePointCost(camera.camera, o, mark, network->TotalCov(o), image.outer >= 0), loss,
        x);
  }
}

/// A-priori positions; robustly each by itself, for a loss judges one residual as a whole.
void AddPointPriors(const Network& network, Blocks* blocks, ceres::LossFunction* loss,
                    ceres::Problem* problem) {
  const PriorBlock& block = network.prior_block;
  std::vector<double*> together;
  for (std::size_t i = 0; loss == nullptr && i < block.points.size(); ++i) {
    if (block.in_weight[i]) together.push_back(blocks->point[block.points[i]].data());
  }
  if (!together.empty()) problem->AddResidualBlock(new PriorBlockCost(block), nullptr, together);
  std::vector<bool> done(network.points.size(), false);
  for (const int p : block.points) done[p] = loss == nullptr;
  for (std::size_t i = 0; i < network.points.size(); ++i) {
    const NetworkPoint& p = network.points[i];
    if (done[i] || !p.is_observed()) continue;
    Eigen::Matrix3d whiten = Eigen::Matrix3d::Identity();
    p.prior_cov_mm2.llt().matrixL().solveInPlace(whiten);
    problem->AddResidualBlock(new PriorCost<3>(p.prior_mm, whiten), loss, blocks->point[i].data());
  }
}

void AddBars(const Network& network, Blocks* blocks, ceres::LossFunction* loss,
             ceres::Problem* problem) {
  for (const NetworkScaleBar& bar : network.scale_bars) {
    if (!bar.used) continue;
    problem->AddResidualBlock(new BarCost(bar), loss, blocks->point[bar.a].data(),
                              blocks->point[bar.b].data());
  }
}

void AddCameraPriors(const Network& network, Blocks* blocks, ceres::Problem* problem) {
  using Cost = PriorCost<kNumCameraUnknowns>;
  for (std::size_t i = 0; i < network.cameras.size(); ++i) {
    const NetworkCamera& c = network.cameras[i];
    if (!problem->HasParameterBlock(blocks->camera[i].data())) continue;
    const CameraVector scale = CameraScale(c.camera);
    Cost::Matrix whiten = Cost::Matrix::Zero();
    bool any = false;
    for (int k = 0; k < kNumCameraUnknowns; ++k) {
      if (!c.free[k] || !(c.prior_sigma[k] > 0)) continue;
      whiten(k, k) = scale[k] / c.prior_sigma[k];
      any = true;
    }
    if (!any) continue;
    problem->AddResidualBlock(new Cost(c.start.cwiseQuotient(scale), whiten), nullptr,
                              blocks->camera[i].data());
  }
}

void HoldFixed(const Network& network, Blocks* blocks, ceres::Problem* problem) {
  for (std::size_t i = 0; i < network.cameras.size(); ++i) {
    double* x = blocks->camera[i].data();
    if (!problem->HasParameterBlock(x)) continue;
    std::vector<int> held;
    for (int k = 0; k < kNumCameraUnknowns; ++k) {
      if (!network.cameras[i].free[k]) held.push_back(k);
    }
    if (held.size() == kNumCameraUnknowns) {
      problem->SetParameterBlockConstant(x);
    } else if (!held.empty()) {
      problem->SetManifold(x, new ceres::SubsetManifold(kNumCameraUnknowns, held));
    }
  }
  for (std::size_t i = 0; i < network.poses.size(); ++i) {
    double* x = blocks->pose[i].data();
    if (!problem->HasParameterBlock(x)) continue;
    if (network.poses[i].free) {
      problem->SetManifold(x, new PoseManifold());
    } else {
      problem->SetParameterBlockConstant(x);
    }
  }
  for (std::size_t i = 0; i < network.points.size(); ++i) {
    double* x = blocks->point[i].data();
    if (!network.points[i].is_unknown() && problem->HasParameterBlock(x)) {
      problem->SetParameterBlockConstant(x);
    }
  }
}

/// Holds the object's frame by the pose that sees the most. Without it, and with circles, whose
/// held normals tell the frame's direction very weakly, the steps would creep along a valley.
void HoldOnePose(const Network& network, Blocks* blocks, ceres::Problem* problem) {
  std::vector<int> count(network.poses.size());
  for (const NetworkObservation& o : network.observations) {
    if (o.used) ++count[network.images[o.image].inner];
  }
  const auto most = std::max_element(count.begin(), count.end()) - count.begin();
  double* x = blocks->pose[static_cast<std::size_t>(most)].data();
  if (problem->HasParameterBlock(x)) problem->SetParameterBlockConstant(x);
}

/// First the blocks that Elimination eliminates, of a group of points joined by bars one point.
std::shared_ptr<ceres::ParameterBlockOrdering> EliminationOrder(const UnknownIndex& index,
                                                                const Elimination& elimination,
                                                                Blocks* blocks,
                                                                const ceres::Problem& problem) {
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  auto add = [&](double* x, int first_unknown) {
    if (!problem.HasParameterBlock(x)) return;
    // Held blocks are taken out by Ceres itself.
    const int block = first_unknown < 0 ? -1 : elimination.block_of[first_unknown];
    const bool first = block >= 0 && elimination.blocks[block].front() == first_unknown;
    ordering->AddElementToGroup(x, first ? 0 : 1);
  };
  for (std::size_t i = 0; i < blocks->point.size(); ++i) {
    add(blocks->point[i].data(), index.point[i]);
  }
  for (std::size_t i = 0; i < blocks->pose.size(); ++i) {
    add(blocks->pose[i].data(), index.pose[i]);
  }
  for (auto& x : blocks->camera) add(x.data(), -1);
  return ordering;
}

/// Levenberg-Marquardt with step control for starts far off.
BundleSummary SolveWithCeres(Network* network, const BundleOptions& options) {
  Blocks blocks(*network);
  std::unique_ptr<ceres::LossFunction> loss;
  if (options.cauchy_scale > 0) loss = std::make_unique<ceres::CauchyLoss>(options.cauchy_scale);
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(problem_options);
  AddImagePoints(network, &blocks, loss.get(), &problem);
  AddPointPriors(*network, &blocks, loss.get(), &problem);
  AddBars(*network, &blocks, loss.get(), &problem);
  AddCameraPriors(*network, &blocks, &problem);
  HoldFixed(*network, &blocks, &problem);

  const UnknownIndex index(*network);
  const Elimination elimination(*network, index);
  ceres::Solver::Options solver;
  // Networks join nearly all of the reduced unknowns with each other (every
  // picture sees many points): dense, unless its square no longer fits into memory.
  solver.linear_solver_type =
      elimination.reduced.size() <= 12000 ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
  solver.linear_solver_ordering = EliminationOrder(index, elimination, &blocks, problem);
  solver.max_num_iterations = options.max_iterations;
  solver.num_threads = ResolveThreads(options.num_threads);
  solver.function_tolerance = options.function_tolerance;
  solver.parameter_tolerance = 1e-14;
  solver.gradient_tolerance = 1e-14;
  solver.initial_trust_region_radius = options.near_solution ? 1e12 : 1e4;
  solver.max_trust_region_radius = 1e16;
  const int free_datum = FreeDatumSize(*network);
  if (free_datum > 0) HoldOnePose(*network, &blocks, &problem);
  if (free_datum == 7) {
    // The damping is what holds the scale: 1e-8 of the diagonal moves nothing
    // that is determined and leaves the equations solvable.
    solver.max_trust_region_radius = 1e8;
    solver.initial_trust_region_radius = std::min(solver.initial_trust_region_radius, 1e8);
  }
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);

  if (summary.IsSolutionUsable()) {
    blocks.WriteTo(network);
    FitToDatum(network);
  }
  BundleSummary result;
  result.converged = summary.termination_type == ceres::CONVERGENCE;
  result.iterations = static_cast<int>(summary.iterations.size());
  result.initial_cost = summary.initial_cost;
  result.final_cost = summary.final_cost;
  result.message = summary.message;
  return result;
}

}  // namespace

BundleSummary SolveBundle(Network* network, const BundleOptions& options) {
  network->Check();
  for (NetworkObservation& o : network->observations) {
    o.used = o.used && PredictImagePoint(*network, o.image, o.point, o.velocity_px).has_value();
  }
  if (const auto solved = SolveNormalEquations(network, options)) return *solved;
  return SolveWithCeres(network, options);
}

}  // namespace videogrammetry
