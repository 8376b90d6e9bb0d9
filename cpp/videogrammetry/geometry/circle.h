#pragma once

#include <Eigen/Core>
#include <optional>

#include "videogrammetry/geometry/camera.h"

namespace videogrammetry {

/// A circle in space, in whatever frame its centre is stated.
struct Circle {
  Eigen::Vector3d center_mm = Eigen::Vector3d::Zero();
  /// Unit normal. Its sign does not matter for the circle's picture.
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double radius_mm = 0.0;

  /// @throws std::invalid_argument if the radius is not positive, the normal not
  ///     of unit length or a number not finite; `what` begins the message.
  void Check(const char* what) const;
};

/// Derivatives of an ellipse's centre, px per unit; columns as InteriorIndex.
struct EllipseCenterJacobians {
  Eigen::Matrix<double, 2, 3> by_center;
  Eigen::Matrix<double, 2, 3> by_normal;
  Eigen::Matrix<double, 2, kNumInterior> by_interior;
};

/// Centre of the ellipse that a circle's picture is: what a camera measures.
/// It is not the picture of the circle's centre.
///
/// With the centre c, unit normal n, radius r in the camera's frame the dual
/// conic of the circle's central projection is (from M diag(1, 1, -1/r^2) M^T,
/// M = [u v c] the map of the circle's plane, u and v its axes; u u^T + v v^T =
/// I - n n^T)
///   C* = r^2 (I - n n^T) - c c^T                                          (1)
/// and a conic's centre is C* e_z, for it is the pole of the line at infinity:
/// the ideal ellipse's centre is the central projection of the point
///   c' = c - (r^2 / c_z) (e_z - n_z n).                                   (2)
/// Exact; on the axis at the tilt t it is the known d^2/(4 f) sin t cos t.
///
/// Distortion then maps the ellipse to a curve that is none. To second order in
/// its size the image of the ellipse c + B (cos, sin) is, in the frame where it
/// is the unit circle, displaced by h[u, u]/2 with h the map's second
/// derivative, and the least-squares circle's centre moves by
///   (3 h_xx,x + h_yy,x + 2 h_xy,y, 3 h_yy,y + h_xx,y + 2 h_xy,x) / 8,     (3)
/// added in px: 0.004 px for a dot of 30 px under A1 = 1e-8 px^-2 at 600 px from
/// the principal point. Left out are the third order (1e-5 px there) and that a
/// fit weights the points of a flat ellipse unevenly (a fifth of (3)).
///
/// @param jacobians  of the distorted projection of (2); (3) is constant in
///     them, which is right to a part in 1e3 of A1...B2 and in 1e5 of the rest.
/// @return nullopt if the circle reaches behind the camera or where the
///     distortion folds over.
std::optional<Eigen::Vector2d> ProjectEllipseCenter(const Camera& camera,
                                                    const Circle& circle_in_cam,
                                                    EllipseCenterJacobians* jacobians = nullptr);

/// The part (3) of ProjectEllipseCenter, px: the least-squares centre of the
/// distorted ellipse less the distorted centre of the ellipse.
///
/// @param center_px  the distorted centre, pixel frame.
/// @param ideal_shape_px2  S of the undistorted ellipse: {c + A u, |u| = 1}, S = A A^T.
Eigen::Vector2d DistortionShift(const Camera& camera, const Eigen::Vector2d& center_px,
                                const Eigen::Matrix2d& ideal_shape_px2);

/// Shape S of the circle's ideal ellipse in the plane z = 1, {e + A u, |u| = 1}
/// with S = A A^T, as (S_xx, S_xy, S_yy), and its derivatives by the normal and
/// by the logarithm of the radius (4 columns): with (1) scaled to C*_zz = -1,
/// C* = [S - e e^T, -e; -e^T, -1].
///
/// @return nullopt if the circle reaches behind the camera.
std::optional<Eigen::Vector3d> ProjectedShape(
    const Circle& circle_in_cam, Eigen::Matrix<double, 3, 4>* by_normal_and_log_radius = nullptr);

}  // namespace videogrammetry
