#pragma once

#include <Eigen/Core>

#include "videogrammetry/adjustment/network.h"

namespace videogrammetry {

/// How a point moves with the object's frame: dX = dt + dw x X + ds X; columns
/// shift (3), rotation vector (3), scale.
Eigen::Matrix<double, 3, 7> HelmertOfPoint(const Eigen::Vector3d& position_mm);

/// Number of datum parameters that the observations of a network with
/// Datum::kFree leave open: 6, or 7 where no scale bar and no held outer pose
/// away from its origin gives the scale. 0 of another datum, and where a fixed
/// point, an a-priori position or a held inner pose says (if only in part) where the
/// object is: a defect that is left then is a rank defect.
int FreeDatumSize(const Network& network);

/// Null space G (num_unknowns, FreeDatumSize) of a free network's normal
/// equations: how the unknowns answer to a motion of the object's frame that
/// no picture shows. Points as HelmertOfPoint; a pose (R, t) from the object,
///   w = -R dw,  d = -R dt + ds t,
/// an outer pose of a rig d = ds t.
Eigen::MatrixXd DatumNullSpace(const Network& network, const UnknownIndex& index);

/// Moves a free network (points and poses) as a whole such that its points
/// fit their a-priori positions `prior_mm` best: to first order this is what the inner
/// constraints demand. Does nothing where FreeDatumSize is 0.
void FitToDatum(Network* network);

/// Orthonormal basis of the columns' span.
Eigen::MatrixXd Orthonormalised(const Eigen::MatrixXd& columns);

}  // namespace videogrammetry
