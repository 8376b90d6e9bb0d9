#pragma once

#include <Eigen/Core>
#include <vector>

#include "videogrammetry/geometry/rigid3.h"

namespace videogrammetry {

/// Essential matrices E with ray_b' E ray_a = 0 for five pairs of rays, all real
/// solutions (0 to 10): det E = 0 and 2 E E'E - tr(E E') E = 0 on the null space
/// of the five equations (Nister, IEEE PAMI 26 (2004), Eqs. 1-5), solved by the
/// eigenvectors of the multiplication by x in the quotient ring (Stewenius, Engels,
/// Nister, ISPRS J. 60 (2006), Sec. 3.3).
///
/// @param rays_a, rays_b  columns: directions in the two cameras' frames.
std::vector<Eigen::Matrix3d> EssentialFromFive(const Eigen::Matrix<double, 3, 5>& rays_a,
                                               const Eigen::Matrix<double, 3, 5>& rays_b);

/// The four motions b_from_a with |t| = 1 and E ~ [t]x R (Hartley & Zisserman, Result 9.19).
std::vector<Rigid3> PosesFromEssential(const Eigen::Matrix3d& essential);

/// The motions of a plane's homography ray_b ~ H ray_a that see all rays' points
/// before camera a (Ma, Soatto, Kosecka, Sastry, An Invitation to 3-D Vision, Sec.
/// 5.3.3), |t| = 1: two, or one where every ray cannot be before both planes.
/// Empty if H is a rotation: then there is no baseline.
///
/// @param rays_a  (N, 3) rows (X/Z, Y/Z, 1).
std::vector<Rigid3> PosesFromPlane(const Eigen::Matrix3d& homography,
                                   const Eigen::Ref<const Eigen::MatrixX3d>& rays_a,
                                   const Eigen::Ref<const Eigen::MatrixX3d>& rays_b);

}  // namespace videogrammetry
