#include "videogrammetry/adjustment/bundle.h"

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <memory>

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

/// Whitened residual measured - predicted; blocks: interior (in units of
/// InteriorScale), [outer pose,] inner pose, point.
class ImagePointCost : public ceres::CostFunction {
 public:
  ImagePointCost(const Camera& camera, const NetworkObservation& o, const Circle& mark,
                 const Eigen::Matrix2d& cov, bool has_outer)
      : camera_(camera),
        scale_(InteriorScale(camera)),
        mark_(mark),
        xy_px_(o.xy_px),
        has_outer_(has_outer) {
    whiten_ = Eigen::Matrix2d::Identity();
    cov.llt().matrixL().solveInPlace(whiten_);
    set_num_residuals(2);
    auto* sizes = mutable_parameter_block_sizes();
    *sizes = has_outer ? std::vector<int32_t>{kNumInterior, kPoseSize, kPoseSize, 3}
                       : std::vector<int32_t>{kNumInterior, kPoseSize, 3};
  }

  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    Camera camera = camera_;
    camera.interior = As<InteriorVector>(x[0]).cwiseProduct(scale_);
    if (!(camera.f_px() > 0)) return false;
    const Rigid3 outer = has_outer_ ? PoseFrom(x[1]) : Rigid3();
    const int inner = has_outer_ ? 2 : 1;
    Circle mark = mark_;
    mark.center_mm = As<Eigen::Vector3d>(x[inner + 1]);
    ImagePointJacobians j;
    const auto pixel = PredictImagePoint(camera, has_outer_ ? &outer : nullptr, PoseFrom(x[inner]),
                                         mark, jacobians != nullptr ? &j : nullptr);
    if (!pixel) return false;
    As<Eigen::Vector2d>(residuals).noalias() = whiten_ * (xy_px_ - *pixel);
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) {
      As<Eigen::Matrix<double, 2, kNumInterior, Eigen::RowMajor>>(jacobians[0]) =
          -whiten_ * j.by_interior * scale_.asDiagonal();
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
  InteriorVector scale_;
  Circle mark_;  // its centre is an unknown
  Eigen::Vector2d xy_px_;
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

/// The network's numbers in the blocks that Ceres works on.
struct Blocks {
  std::vector<InteriorVector> interior;
  std::vector<Eigen::Matrix<double, kPoseSize, 1>> pose;
  std::vector<Eigen::Vector3d> point;

  explicit Blocks(const Network& network) {
    for (const NetworkCamera& c : network.cameras) {
      interior.push_back(c.camera.interior.cwiseQuotient(InteriorScale(c.camera)));
    }
    for (const NetworkPose& p : network.poses) {
      pose.emplace_back();
      pose.back() << As<Eigen::Matrix<double, 9, 1>>(p.transform.rotation.data()),
          p.transform.translation_mm;
    }
    for (const NetworkPoint& p : network.points) point.push_back(p.position_mm);
  }

  void WriteTo(Network* network) const {
    for (std::size_t i = 0; i < interior.size(); ++i) {
      Camera& camera = network->cameras[i].camera;
      camera.interior = interior[i].cwiseProduct(InteriorScale(camera));
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
    if (!PredictImagePoint(camera.camera, nullptr, network->CamFromObject(image), mark)) {
      o.used = false;
      continue;
    }
    std::vector<double*> x = {blocks->interior[image.camera].data()};
    if (image.outer >= 0) x.push_back(blocks->pose[image.outer].data());
    x.push_back(blocks->pose[image.inner].data());
    x.push_back(blocks->point[o.point].data());
    problem->AddResidualBlock(
        new ImagePointCost(camera.camera, o, mark, network->TotalCov(o), image.outer >= 0), loss,
        x);
  }
}

void AddPriors(const Network& network, Blocks* blocks, ceres::Problem* problem) {
  for (std::size_t i = 0; i < network.points.size(); ++i) {
    const NetworkPoint& p = network.points[i];
    if (p.kind != PointKind::kWeighted || !problem->HasParameterBlock(blocks->point[i].data())) {
      continue;
    }
    Eigen::Matrix3d whiten = Eigen::Matrix3d::Identity();
    p.prior_cov_mm2.llt().matrixL().solveInPlace(whiten);
    problem->AddResidualBlock(new PriorCost<3>(p.prior_mm, whiten), nullptr,
                              blocks->point[i].data());
  }
  for (std::size_t i = 0; i < network.cameras.size(); ++i) {
    const NetworkCamera& c = network.cameras[i];
    if (!problem->HasParameterBlock(blocks->interior[i].data())) continue;
    const InteriorVector scale = InteriorScale(c.camera);
    PriorCost<kNumInterior>::Matrix whiten = PriorCost<kNumInterior>::Matrix::Zero();
    bool any = false;
    for (int k = 0; k < kNumInterior; ++k) {
      if (!c.free[k] || !(c.prior_sigma[k] > 0)) continue;
      whiten(k, k) = scale[k] / c.prior_sigma[k];
      any = true;
    }
    if (!any) continue;
    problem->AddResidualBlock(new PriorCost<kNumInterior>(c.start.cwiseQuotient(scale), whiten),
                              nullptr, blocks->interior[i].data());
  }
}

void HoldFixed(const Network& network, Blocks* blocks, ceres::Problem* problem) {
  for (std::size_t i = 0; i < network.cameras.size(); ++i) {
    double* x = blocks->interior[i].data();
    if (!problem->HasParameterBlock(x)) continue;
    std::vector<int> held;
    for (int k = 0; k < kNumInterior; ++k) {
      if (!network.cameras[i].free[k]) held.push_back(k);
    }
    if (held.size() == kNumInterior) {
      problem->SetParameterBlockConstant(x);
    } else if (!held.empty()) {
      problem->SetManifold(x, new ceres::SubsetManifold(kNumInterior, held));
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
    if (network.points[i].kind == PointKind::kFixed && problem->HasParameterBlock(x)) {
      problem->SetParameterBlockConstant(x);
    }
  }
}

std::shared_ptr<ceres::ParameterBlockOrdering> EliminationOrder(const Network& network,
                                                                Blocks* blocks,
                                                                const ceres::Problem& problem) {
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  bool any_point = false;
  for (const NetworkPoint& p : network.points) any_point |= p.kind != PointKind::kFixed;
  std::vector<bool> is_inner(network.poses.size(), false);
  if (!any_point) {
    for (const NetworkImage& image : network.images) is_inner[image.inner] = true;
  }
  for (auto& x : blocks->point) {
    if (problem.HasParameterBlock(x.data())) ordering->AddElementToGroup(x.data(), 0);
  }
  for (std::size_t i = 0; i < blocks->pose.size(); ++i) {
    double* x = blocks->pose[i].data();
    if (problem.HasParameterBlock(x)) ordering->AddElementToGroup(x, is_inner[i] ? 0 : 1);
  }
  for (auto& x : blocks->interior) {
    if (problem.HasParameterBlock(x.data())) ordering->AddElementToGroup(x.data(), 1);
  }
  return ordering;
}

}  // namespace

BundleSummary SolveBundle(Network* network, const BundleOptions& options) {
  network->Check();
  Blocks blocks(*network);
  std::unique_ptr<ceres::LossFunction> loss;
  if (options.cauchy_scale > 0) loss = std::make_unique<ceres::CauchyLoss>(options.cauchy_scale);
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(problem_options);
  AddImagePoints(network, &blocks, loss.get(), &problem);
  AddPriors(*network, &blocks, &problem);
  HoldFixed(*network, &blocks, &problem);

  const UnknownIndex index(*network);
  ceres::Solver::Options solver;
  // A dense reduced system up to a size where its cube is still milliseconds.
  solver.linear_solver_type = index.num_reduced <= 600 ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
  solver.linear_solver_ordering = EliminationOrder(*network, &blocks, problem);
  solver.max_num_iterations = options.max_iterations;
  solver.num_threads = ResolveThreads(options.num_threads);
  // A relative change of v'Pv of 1e-10 moves no unknown by 1e-3 of its sigma.
  solver.function_tolerance = 1e-10;
  solver.parameter_tolerance = 1e-14;
  solver.gradient_tolerance = 1e-14;
  solver.initial_trust_region_radius = options.near_solution ? 1e12 : 1e4;
  solver.max_trust_region_radius = 1e16;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);

  if (summary.IsSolutionUsable()) blocks.WriteTo(network);
  BundleSummary result;
  result.converged = summary.termination_type == ceres::CONVERGENCE;
  result.iterations = static_cast<int>(summary.iterations.size());
  result.initial_cost = summary.initial_cost;
  result.final_cost = summary.final_cost;
  result.message = summary.message;
  return result;
}

}  // namespace videogrammetry
