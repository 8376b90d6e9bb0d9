#pragma once

#include <ceres/ceres.h>

#include <Eigen/Core>
#include <memory>

#include "videogrammetry/adjustment/network.h"

namespace videogrammetry {

/// The network's terms as Ceres takes them: residuals over their standard deviations
/// ("whitened") of blocks of unknowns, with their derivatives. Blocks are a camera's values
/// in units of CameraScale, a pose as PoseBlock, a window's values, a point.

/// Rotation matrix, column by column, then the shift.
constexpr int kPoseBlock = 12;
using PoseBlock = Eigen::Matrix<double, kPoseBlock, 1>;
PoseBlock BlockFromPose(const Rigid3& pose);
Rigid3 PoseFromBlock(const double* x);

/// R <- exp([w]) R, t <- t + d of a PoseBlock.
std::unique_ptr<ceres::Manifold> MakePoseManifold();

/// measured - predicted (PredictObservation); blocks: camera, [outer pose,] inner pose,
/// point[, window]. Cannot be evaluated where the point has no picture.
std::unique_ptr<ceres::CostFunction> MakeImagePointCost(const Network& network,
                                                        const NetworkObservation& observation);

/// W (prior - x) of one block.
std::unique_ptr<ceres::CostFunction> MakePriorCost(const Eigen::VectorXd& prior,
                                                   const Eigen::MatrixXd& whiten);

/// Given - present length; blocks: the bar's two points, which must differ.
std::unique_ptr<ceres::CostFunction> MakeBarCost(const NetworkScaleBar& bar);

/// W (mean - x); blocks: the prior block's points that take part, in their order.
std::unique_ptr<ceres::CostFunction> MakePriorBlockCost(const PriorBlock& block);

}  // namespace videogrammetry
