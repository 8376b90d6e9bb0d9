#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "videogrammetry/adjustment/dlt.h"

namespace videogrammetry {

/// Homography from plane coordinates to pixels by the normalised linear
/// method (Hartley & Zisserman, Alg. 4.2), N >= 4.
/// @return nullopt if three or more of four points are collinear or coincide
///     (no unique solution).
/// @throws std::invalid_argument if N < 4 or the counts differ.
std::optional<Eigen::Matrix3d> FitHomography(const Eigen::Ref<const Points2d>& plane_mm,
                                             const Eigen::Ref<const Points2d>& pixels);

/// cam_from_plane of a homography to ideal image points (from the principal
/// point) of a camera of principal distance f: H ~ diag(f, f, 1) [r1 r2 t].
Rigid3 PoseFromHomography(const Eigen::Matrix3d& homography, double f_px);

/// The other pose of a plane that fits a narrow-angle picture almost as well:
/// the object mirrored at its plane and in depth, about the point `centre_mm`
/// of the object whose picture stays. (Weak perspective cannot tell the two
/// apart; both must be refined.)
/// @param plane_normal  unit normal of the object's plane, object frame.
Rigid3 FlippedPose(const Rigid3& cam_from_object, const Eigen::Vector3d& centre_mm,
                   const Eigen::Vector3d& plane_normal);

/// f from homographies of one or more pictures of planes, x0 = y0 = 0, equal
/// scales: the two conditions h1'W h2 = 0, h1'W h1 = h2'W h2 on
/// W = diag(1/f^2, 1/f^2, 1) (Zhang 2000, Eqs. 3-4), least squares in 1/f^2.
/// @return nullopt if the planes stand (nearly) square to the axis, so that
///     the conditions hold for every f.
std::optional<double> FocalFromHomographies(const std::vector<Eigen::Matrix3d>& homographies);

}  // namespace videogrammetry
