#pragma once

#include <Eigen/Core>
#include <optional>

namespace videogrammetry {

/// A flat window between the cameras' air and a fluid: the plane
/// normal . X = distance_mm of the world's frame, `normal` unit and pointing to
/// the cameras. Behind it (a pane of glass_thickness_mm, then) the fluid.
struct FlatInterface {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double distance_mm = 0.0;
  double fluid_index = 1.333;  ///< over that of air
  double glass_index = 1.0;
  double glass_thickness_mm = 0.0;

  /// @throws std::invalid_argument, beginning with `what`, if the normal is not
  ///     of unit length, an index below 1 or above 4 or the thickness negative.
  void Check(const char* what) const;
};

/// Derivatives of the point of the surface through which a point is seen (mm
/// per mm; by the normal mm per unit, to be used along tangents of the sphere).
struct RefractionJacobians {
  Eigen::Matrix3d by_point;
  Eigen::Matrix3d by_center;
  Eigen::Matrix3d by_normal;
  Eigen::Vector3d by_distance;
};

/// The point S of the camera-side surface through which a camera at `center_mm`
/// sees a point behind it.
///
/// Snell's law in the plane of incidence (Maas, New developments in multimedia
/// photogrammetry, 1995; Mulsow, A flexible multi-media bundle approach, ISPRS
/// Archives 38-5, 2010; Agrawal et al., A theory of multi-layer flat refractive
/// geometry, CVPR 2012). With a the camera's height over the surface, h_i, n_i
/// the layers' thicknesses and indices (the last one ends at the point), v the
/// part along the surface of the way from camera to point and tan(theta) = k |v|
/// in air,
///   k a + sum_i h_i k / sqrt(n_i^2 + (n_i^2 - 1) k^2 v.v) = 1,
///   S = C - a n + a k v.
/// As an equation of 1 / k it is concave and falls at its root: Newton's method from
/// 1 / k = a + sum h_i / n_i converges from that side, without a bound on the angle and
/// without a special case at perpendicular incidence. Derivatives: implicit.
///
/// A point in front of the surface is seen straight: S is the point itself.
/// @return nullopt if the camera is not in front of the surface.
std::optional<Eigen::Vector3d> SeenThrough(const FlatInterface& interface,
                                           const Eigen::Vector3d& point_mm,
                                           const Eigen::Vector3d& center_mm,
                                           RefractionJacobians* jacobians = nullptr);

/// A ray: origin and unit direction.
struct Ray {
  Eigen::Vector3d origin_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();
};

/// Derivatives of a refracted ray by the direction of the ray in air.
struct RayJacobians {
  Eigen::Matrix3d origin_by_direction;
  Eigen::Matrix3d direction_by_direction;
};

/// The ray in the fluid that continues a camera's ray: its origin is where it
/// leaves the window. With d the unit direction in air and c_i = sqrt(n_i^2 -
/// 1 + (d.n)^2) the refracted direction is (d_t - c n) / n_i, d_t = d - (d.n) n.
///
/// @param direction  from the camera, of any length.
/// @return nullopt if the ray does not meet the surface from the front.
std::optional<Ray> RefractRay(const FlatInterface& interface, const Eigen::Vector3d& center_mm,
                              const Eigen::Vector3d& direction, RayJacobians* jacobians = nullptr);

}  // namespace videogrammetry
