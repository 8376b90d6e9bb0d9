#include "videogrammetry/adjustment/ceres_bundle.h"

#include <ceres/ceres.h>
#ifdef VIDEOGRAMMETRY_GLOG
#include <glog/logging.h>
#endif

#include <Eigen/Cholesky>
#include <algorithm>
#include <memory>
#include <mutex>

#include "videogrammetry/adjustment/ceres_costs.h"
#include "videogrammetry/adjustment/datum.h"
#include "videogrammetry/adjustment/elimination.h"
#include "videogrammetry/core/thread_pool.h"

namespace videogrammetry {
namespace {

/// The network's numbers in the blocks that Ceres works on.
struct Blocks {
  std::vector<CameraVector> camera;
  std::vector<PoseBlock> pose;
  std::vector<Eigen::Vector3d> interface;
  std::vector<Eigen::Vector3d> point;

  explicit Blocks(const Network& network) {
    for (const NetworkCamera& c : network.cameras) {
      camera.push_back(c.values().cwiseQuotient(CameraScale(c.camera)));
    }
    for (const NetworkPose& p : network.poses) pose.push_back(BlockFromPose(p.transform));
    for (const NetworkInterface& i : network.interfaces) interface.push_back(i.values());
    for (const NetworkPoint& p : network.points) point.push_back(p.position_mm);
  }

  void WriteTo(Network* network) const {
    for (std::size_t i = 0; i < camera.size(); ++i) {
      NetworkCamera& c = network->cameras[i];
      c.set_values(camera[i].cwiseProduct(CameraScale(c.camera)));
    }
    for (std::size_t i = 0; i < pose.size(); ++i) {
      if (!network->poses[i].free) continue;
      Rigid3 transform = PoseFromBlock(pose[i].data());
      transform.rotation = NearestRotation(transform.rotation);  // rounding of many small turns
      network->poses[i].transform = transform;
    }
    for (std::size_t i = 0; i < interface.size(); ++i) {
      network->interfaces[i].set_values(interface[i]);
    }
    for (std::size_t i = 0; i < point.size(); ++i) network->points[i].position_mm = point[i];
  }
};

void AddImagePoints(const Network& network, Blocks* blocks, ceres::LossFunction* loss,
                    ceres::Problem* problem) {
  for (const NetworkObservation& o : network.observations) {
    if (!o.used) continue;
    const NetworkImage& image = network.images[o.image];
    const NetworkCamera& camera = network.cameras[image.camera];
    std::vector<double*> x = {blocks->camera[image.camera].data()};
    if (image.outer >= 0) x.push_back(blocks->pose[image.outer].data());
    x.push_back(blocks->pose[image.inner].data());
    x.push_back(blocks->point[o.point].data());
    if (camera.interface >= 0) x.push_back(blocks->interface[camera.interface].data());
    problem->AddResidualBlock(MakeImagePointCost(network, o).release(), loss, x);
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
  if (!together.empty())
    problem->AddResidualBlock(MakePriorBlockCost(block).release(), nullptr, together);
  std::vector<bool> done(network.points.size(), false);
  for (const int p : block.points) done[p] = loss == nullptr;
  for (std::size_t i = 0; i < network.points.size(); ++i) {
    const NetworkPoint& p = network.points[i];
    if (done[i] || !p.is_observed()) continue;
    Eigen::Matrix3d whiten = Eigen::Matrix3d::Identity();
    p.prior_cov_mm2.llt().matrixL().solveInPlace(whiten);
    problem->AddResidualBlock(MakePriorCost(p.prior_mm, whiten).release(), loss,
                              blocks->point[i].data());
  }
}

void AddBars(const Network& network, Blocks* blocks, ceres::LossFunction* loss,
             ceres::Problem* problem) {
  for (const NetworkScaleBar& bar : network.scale_bars) {
    if (!bar.used) continue;
    problem->AddResidualBlock(MakeBarCost(bar).release(), loss, blocks->point[bar.a].data(),
                              blocks->point[bar.b].data());
  }
}

void AddCameraPriors(const Network& network, Blocks* blocks, ceres::Problem* problem) {
  for (std::size_t i = 0; i < network.cameras.size(); ++i) {
    const NetworkCamera& c = network.cameras[i];
    if (!problem->HasParameterBlock(blocks->camera[i].data())) continue;
    const CameraVector scale = CameraScale(c.camera);
    Eigen::MatrixXd whiten = Eigen::MatrixXd::Zero(kNumCameraUnknowns, kNumCameraUnknowns);
    bool any = false;
    for (int k = 0; k < kNumCameraUnknowns; ++k) {
      if (!c.free[k] || !(c.prior_sigma[k] > 0)) continue;
      whiten(k, k) = scale[k] / c.prior_sigma[k];
      any = true;
    }
    if (!any) continue;
    problem->AddResidualBlock(MakePriorCost(c.start.cwiseQuotient(scale), whiten).release(),
                              nullptr, blocks->camera[i].data());
  }
}

void AddInterfacePriors(const Network& network, Blocks* blocks, ceres::Problem* problem) {
  for (std::size_t i = 0; i < network.interfaces.size(); ++i) {
    const NetworkInterface& window = network.interfaces[i];
    if (!problem->HasParameterBlock(blocks->interface[i].data())) continue;
    Eigen::Matrix3d whiten = Eigen::Matrix3d::Zero();
    for (int k = 0; k < kNumInterfaceUnknowns; ++k) {
      if (window.free[k] && window.prior_sigma[k] > 0) whiten(k, k) = 1 / window.prior_sigma[k];
    }
    if (whiten.isZero(0)) continue;
    problem->AddResidualBlock(MakePriorCost(window.start(), whiten).release(), nullptr,
                              blocks->interface[i].data());
  }
}

/// Holds a block of which only some numbers are unknowns.
template <std::size_t N>
void HoldSome(const std::array<bool, N>& free, double* x, ceres::Problem* problem) {
  if (!problem->HasParameterBlock(x)) return;
  std::vector<int> held;
  for (std::size_t k = 0; k < N; ++k) {
    if (!free[k]) held.push_back(static_cast<int>(k));
  }
  if (held.size() == N) {
    problem->SetParameterBlockConstant(x);
  } else if (!held.empty()) {
    problem->SetManifold(x, new ceres::SubsetManifold(static_cast<int>(N), held));
  }
}

void HoldFixed(const Network& network, Blocks* blocks, ceres::Problem* problem) {
  for (std::size_t i = 0; i < network.cameras.size(); ++i) {
    HoldSome(network.cameras[i].free, blocks->camera[i].data(), problem);
  }
  for (std::size_t i = 0; i < network.interfaces.size(); ++i) {
    HoldSome(network.interfaces[i].free, blocks->interface[i].data(), problem);
  }
  for (std::size_t i = 0; i < network.poses.size(); ++i) {
    double* x = blocks->pose[i].data();
    if (!problem->HasParameterBlock(x)) continue;
    if (network.poses[i].free) {
      problem->SetManifold(x, MakePoseManifold().release());
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
  for (auto& x : blocks->interface) add(x.data(), -1);
  return ordering;
}

/// Ceres tells of each step that it has to repeat by LOG(WARNING), and of giving up by
/// LOG(ERROR). logging_type does not reach them, and they go to stderr, which is not a
/// library's; what they say is in Ceres' summary. What ends the process is still said.
void SilenceLog() {
#ifdef VIDEOGRAMMETRY_GLOG
  static std::once_flag once;
  std::call_once(once, [] { FLAGS_minloglevel = std::max(FLAGS_minloglevel, google::GLOG_FATAL); });
#endif
}

}  // namespace

BundleSummary SolveWithCeres(Network* network, const BundleOptions& options) {
  SilenceLog();
  Blocks blocks(*network);
  std::unique_ptr<ceres::LossFunction> loss;
  if (options.cauchy_scale > 0) loss = std::make_unique<ceres::CauchyLoss>(options.cauchy_scale);
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(problem_options);
  AddImagePoints(*network, &blocks, loss.get(), &problem);
  AddPointPriors(*network, &blocks, loss.get(), &problem);
  AddBars(*network, &blocks, loss.get(), &problem);
  AddCameraPriors(*network, &blocks, &problem);
  AddInterfacePriors(*network, &blocks, &problem);
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

}  // namespace videogrammetry
