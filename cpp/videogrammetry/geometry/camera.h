#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

namespace videogrammetry {

/// Order of the ten interior parameters in every vector and Jacobian.
enum InteriorIndex { kF = 0, kX0, kY0, kA1, kA2, kA3, kB1, kB2, kE1, kE2, kNumInterior };
inline constexpr std::array<const char*, kNumInterior> kInteriorNames = {
    "f", "x0", "y0", "A1", "A2", "A3", "B1", "B2", "E1", "E2"};

/// Which point the distortion polynomial is a function of.
///   kMeasured: ideal = measured + d(measured), the paper's Eq. (2);
///   kIdeal:    measured = ideal + d(ideal), AICON's and OpenCV's way.
enum class DistortionDirection { kMeasured, kIdeal };

/// The ten-parameter camera of Hu et al. (2012), Eqs. (2)-(3), in pixels.
///
/// With (xc, yc) the image point from the principal point, r^2 = xc^2 + yc^2,
///   dx = A1 xc (r^2 - r0^2) + A2 xc (r^4 - r0^4) + A3 xc (r^6 - r0^6)
///        + B1 (r^2 + 2 xc^2) + 2 B2 xc yc + E1 xc + E2 yc
///   dy = A1 yc (r^2 - r0^2) + A2 yc (r^4 - r0^4) + A3 yc (r^6 - r0^6)
///        + B2 (r^2 + 2 yc^2) + 2 B1 xc yc
/// and, in the measured direction, xc + dx = f X/Z, yc + dy = f Y/Z for the
/// point (X, Y, Z) in the camera's frame (z forward, x right, y down). The
/// picture's pixel is (xc + x0 + (w-1)/2, yc + y0 + (h-1)/2).
struct Camera {
  int width_px = 0;
  int height_px = 0;
  /// f, x0, y0, A1, A2, A3, B1, B2, E1, E2; f, x0, y0 in pixels, A1 in px^-2,
  /// A2 in px^-4, A3 in px^-6, B1 and B2 in px^-1.
  Eigen::Matrix<double, kNumInterior, 1> interior = Eigen::Matrix<double, kNumInterior, 1>::Zero();
  double r0_px = 0.0;
  DistortionDirection direction = DistortionDirection::kMeasured;

  double f_px() const { return interior[kF]; }
  Eigen::Vector2d principal_point_px() const {
    return {interior[kX0] + 0.5 * (width_px - 1), interior[kY0] + 0.5 * (height_px - 1)};
  }
};

/// 2/3 of the half diagonal: where r0 lies when nothing is said.
double DefaultR0Px(int width_px, int height_px);

/// Derivatives of a projection; columns of `by_interior` as InteriorIndex.
struct ProjectionJacobians {
  Eigen::Matrix<double, 2, 3> by_point;
  Eigen::Matrix<double, 2, kNumInterior> by_interior;
};

/// The distortion polynomial d at `point_px` (from the principal point) and,
/// where asked for, its derivatives by the point and by A1...E2 (7 columns).
Eigen::Vector2d Distortion(const Camera& camera, const Eigen::Vector2d& point_px,
                           Eigen::Matrix2d* by_point = nullptr,
                           Eigen::Matrix<double, 2, 7>* by_parameters = nullptr);

/// Picture of a point of the camera's frame.
///
/// The measured direction is inverted by Newton's method to 1e-10 px.
/// @return nullopt if Z <= 0 or if the point lies where the distortion folds
///     over, so that no picture of it exists on the branch that holds the
///     principal point.
std::optional<Eigen::Vector2d> Project(const Camera& camera, const Eigen::Vector3d& point_in_cam,
                                       ProjectionJacobians* jacobians = nullptr);

/// The same with the derivatives, where the picture is known to be near `near_px`.
std::optional<Eigen::Vector2d> ProjectNear(const Camera& camera,
                                           const Eigen::Vector3d& point_in_cam,
                                           const Eigen::Vector2d& near_px,
                                           ProjectionJacobians* jacobians);

/// The same where the picture is known to be near `near_px`, with the derivative by the
/// point alone: the inversion begins there and is done in two steps.
std::optional<Eigen::Vector2d> ProjectNear(const Camera& camera,
                                           const Eigen::Vector3d& point_in_cam,
                                           const Eigen::Vector2d& near_px,
                                           Eigen::Matrix<double, 2, 3>* by_point);

/// The ideal image point (f X/Z, f Y/Z), from the principal point, of a pixel:
/// exact in the measured direction, by Newton's method in the ideal one.
std::optional<Eigen::Vector2d> Undistort(const Camera& camera, const Eigen::Vector2d& pixel);

/// Direction (X/Z, Y/Z, 1) of the ray through a pixel, in the camera's frame;
/// `by_pixel` gets d(X/Z, Y/Z)/d(pixel).
std::optional<Eigen::Vector3d> RayThroughPixel(const Camera& camera, const Eigen::Vector2d& pixel,
                                               Eigen::Matrix2d* by_pixel = nullptr);

}  // namespace videogrammetry
