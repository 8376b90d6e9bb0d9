#pragma once

#include <Eigen/Core>
#include <vector>

#include "videogrammetry/geometry/rigid3.h"

namespace videogrammetry {

/// Poses that see three points along three rays: Grunert's quartic in the
/// form of Haralick et al. (IJCV 13 (1994), Eq. 9).
///
/// A double root split by noise into a complex pair is taken at its real part:
/// in a narrow field the poses are double roots nearly always, and who calls
/// judges the candidates by further points anyway.
///
/// @param points_mm  columns: the points, object frame.
/// @param rays       columns: unit directions, camera frame.
/// @return cam_from_object, 0 to 4 of them (0 for collinear points).
std::vector<Rigid3> SolveP3P(const Eigen::Matrix3d& points_mm, const Eigen::Matrix3d& rays);

/// The two poses under weak perspective (Alter, IEEE PAMI 16 (1994), Eqs. 1-5):
/// start values where the field is so narrow that Grunert's quartic has lost
/// its digits; exact in the limit of a distant object.
///
/// @param ideal_px  columns: f (X/Z, Y/Z) of the three points.
std::vector<Rigid3> SolveWeakPerspective(const Eigen::Matrix3d& points_mm,
                                         const Eigen::Matrix<double, 2, 3>& ideal_px, double f_px);

}  // namespace videogrammetry
