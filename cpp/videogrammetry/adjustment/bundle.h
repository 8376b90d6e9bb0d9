#pragma once

#include <string>

#include "videogrammetry/adjustment/network.h"

namespace videogrammetry {

/// How to minimise.
struct BundleOptions {
  /// Scale of Cauchy's loss in standard deviations; 0 = least squares.
  double cauchy_scale = 0.0;
  int max_iterations = 100;
  /// Near the solution the first step is an undamped Gauss-Newton step; far
  /// from it, it is damped from the start.
  bool near_solution = true;
  /// Stop at this relative change of v'Pv: 1e-10 moves no unknown by 1e-3 of its sigma.
  double function_tolerance = 1e-10;
  /// Or where a step promises to lower v'Pv by no more than this.
  double least_decrease = 1e-16;
  /// 0 = one a core.
  int num_threads = 0;
};

struct BundleSummary {
  bool converged = false;
  int iterations = 0;
  /// Half the weighted sum of squares (of the loss, where there is one).
  double initial_cost = 0.0;
  double final_cost = 0.0;
  std::string message;
};

/// Bundle adjustment: estimates every free unknown of the network from the
/// used observations, scale bars and priors, min v'Pv (Hu et al. 2012, Eqs. 4-6).
///
/// Damped Gauss-Newton on the normal equations (SolveNormalEquations), on analytic
/// Jacobians; where that fails, Ceres (SolveWithCeres). The object points or the inner
/// poses are eliminated first (Elimination). A free network is moved to its datum
/// afterwards (FitToDatum). An observation whose point has no picture at the start
/// values is set to unused.
///
/// @throws std::invalid_argument if the network is malformed (Network::Check).
BundleSummary SolveBundle(Network* network, const BundleOptions& options);

}  // namespace videogrammetry
