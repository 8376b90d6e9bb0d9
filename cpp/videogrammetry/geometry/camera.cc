#include "videogrammetry/geometry/camera.h"

#include <Eigen/LU>
#include <cmath>

namespace videogrammetry {
namespace {

constexpr int kMaxNewton = 30;
/// Of the radius: corrections below this leave no doubt about the branch.
constexpr double kSureShare = 0.1;

struct Inverse {
  Eigen::Vector2d point_px;  // p with p + d(p) = target
  Eigen::Matrix2d jacobian;  // I + dd/dp there
};

bool NewtonStep(const Camera& camera, const Eigen::Vector2d& target_px, Inverse* state,
                double* residual_px) {
  Eigen::Matrix2d by_point;
  const Eigen::Vector2d error =
      state->point_px + Distortion(camera, state->point_px, &by_point) - target_px;
  state->jacobian = Eigen::Matrix2d::Identity() + by_point;
  *residual_px = error.norm();
  if (!(state->jacobian.determinant() > 0)) return false;
  state->point_px -= state->jacobian.inverse() * error;
  return state->point_px.allFinite();
}

std::optional<Inverse> Newton(const Camera& camera, const Eigen::Vector2d& target_px,
                              const Eigen::Vector2d& start_px) {
  Inverse state{start_px, Eigen::Matrix2d::Identity()};
  // Rounding of r^6-type terms grows with the radius; 1e-10 px is the promise.
  const double tolerance = 1e-11 + 4e-15 * target_px.norm();
  double residual = 0;
  for (int i = 0; i < kMaxNewton; ++i) {
    if (!NewtonStep(camera, target_px, &state, &residual)) return std::nullopt;
    if (residual < tolerance) return state;
  }
  return residual < 1e-10 ? std::optional<Inverse>(state) : std::nullopt;
}

/// Solves p + d(p) = target on the branch of the principal point. Where the
/// correction is large, Newton could end on another branch, so the target is
/// approached in steps from the centre, each of which must succeed.
std::optional<Inverse> InvertDistortion(const Camera& camera, const Eigen::Vector2d& target_px) {
  std::optional<Inverse> direct = Newton(camera, target_px, target_px);
  const double large = kSureShare * (target_px.norm() + 1.0);
  if (direct && (direct->point_px - target_px).norm() < large) return direct;

  constexpr int kSteps = 64;
  Eigen::Vector2d start = Eigen::Vector2d::Zero();
  std::optional<Inverse> traced;
  for (int i = 0; i <= kSteps; ++i) {
    const double share = static_cast<double>(i) / kSteps;
    traced = Newton(camera, share * target_px, start);
    if (!traced) return std::nullopt;
    // On one branch the solution moves about as the target does.
    const double moved = (traced->point_px - start).norm();
    if (i > 0 && moved > 4.0 * target_px.norm() / kSteps + 1.0) return std::nullopt;
    start = traced->point_px;
  }
  return traced;
}

/// InvertDistortion where the solution is near `start_px`.
std::optional<Inverse> InvertNear(const Camera& camera, const Eigen::Vector2d& target_px,
                                  const Eigen::Vector2d& start_px) {
  // Newton's next residual is the square of this one times the distortion's
  // curvature, which is under 1e-2 a pixel wherever a lens has one branch.
  constexpr double kSettled = 1e-5;
  constexpr int kSteps = 4;
  Inverse state{start_px, Eigen::Matrix2d::Identity()};
  double residual = 0;
  for (int i = 0; i < kSteps; ++i) {
    if (!NewtonStep(camera, target_px, &state, &residual)) break;
    if (residual > kSettled) continue;
    if ((state.point_px - target_px).norm() < kSureShare * (target_px.norm() + 1.0)) return state;
    break;
  }
  return InvertDistortion(camera, target_px);
}

}  // namespace

double DefaultR0Px(int width_px, int height_px) {
  return std::hypot(static_cast<double>(width_px), static_cast<double>(height_px)) / 3.0;
}

Eigen::Vector2d Distortion(const Camera& camera, const Eigen::Vector2d& point_px,
                           Eigen::Matrix2d* by_point, Eigen::Matrix<double, 2, 7>* by_parameters) {
  const auto& p = camera.interior;
  const double x = point_px.x(), y = point_px.y();
  const double r2 = x * x + y * y, r4 = r2 * r2, r6 = r4 * r2;
  const double s2 = camera.r0_px * camera.r0_px, s4 = s2 * s2, s6 = s4 * s2;
  const double radial = p[kA1] * (r2 - s2) + p[kA2] * (r4 - s4) + p[kA3] * (r6 - s6);
  const Eigen::Vector2d d(  // Eq. (3)
      x * radial + p[kB1] * (r2 + 2 * x * x) + 2 * p[kB2] * x * y + p[kE1] * x + p[kE2] * y,
      y * radial + p[kB2] * (r2 + 2 * y * y) + 2 * p[kB1] * x * y);
  if (by_point != nullptr) {
    const double slope = 2 * (p[kA1] + 2 * p[kA2] * r2 + 3 * p[kA3] * r4);  // d radial / d r^2 * 2
    (*by_point)(0, 0) = radial + slope * x * x + 6 * p[kB1] * x + 2 * p[kB2] * y + p[kE1];
    (*by_point)(0, 1) = slope * x * y + 2 * p[kB1] * y + 2 * p[kB2] * x + p[kE2];
    (*by_point)(1, 0) = slope * x * y + 2 * p[kB2] * x + 2 * p[kB1] * y;
    (*by_point)(1, 1) = radial + slope * y * y + 6 * p[kB2] * y + 2 * p[kB1] * x;
  }
  if (by_parameters != nullptr) {
    *by_parameters << x * (r2 - s2), x * (r4 - s4), x * (r6 - s6), r2 + 2 * x * x, 2 * x * y, x, y,
        y * (r2 - s2), y * (r4 - s4), y * (r6 - s6), 2 * x * y, r2 + 2 * y * y, 0, 0;
  }
  return d;
}

namespace {

/// Project; the inversion begins at `near_px` where that is known.
std::optional<Eigen::Vector2d> ProjectFrom(const Camera& camera,
                                           const Eigen::Vector3d& point_in_cam,
                                           const Eigen::Vector2d* near_px,
                                           ProjectionJacobians* jacobians) {
  const double z = point_in_cam.z();
  if (!(z > 0)) return std::nullopt;
  const double f = camera.f_px();
  const Eigen::Vector2d direction = point_in_cam.head<2>() / z;
  const Eigen::Vector2d ideal = f * direction;
  if (!ideal.allFinite()) return std::nullopt;
  const bool measured = camera.direction == DistortionDirection::kMeasured;

  Eigen::Vector2d image;     // from the principal point
  Eigen::Matrix2d by_ideal;  // d image / d ideal
  if (measured) {
    const std::optional<Inverse> inverse =
        near_px != nullptr ? InvertNear(camera, ideal, *near_px - camera.principal_point_px())
                           : InvertDistortion(camera, ideal);
    if (!inverse) return std::nullopt;
    image = inverse->point_px;
    if (jacobians != nullptr) by_ideal = inverse->jacobian.inverse();
  } else {
    Eigen::Matrix2d by_point;
    image = ideal + Distortion(camera, ideal, &by_point);
    by_ideal = Eigen::Matrix2d::Identity() + by_point;
    if (!(by_ideal.determinant() > 0)) return std::nullopt;
  }

  if (jacobians != nullptr) {
    Eigen::Matrix<double, 2, 7> by_parameters;
    Distortion(camera, measured ? image : ideal, nullptr, &by_parameters);
    Eigen::Matrix<double, 2, 3> ideal_by_point;
    ideal_by_point << f / z, 0, -ideal.x() / z, 0, f / z, -ideal.y() / z;
    jacobians->by_point = by_ideal * ideal_by_point;
    jacobians->by_interior.col(kF) = by_ideal * direction;
    jacobians->by_interior.col(kX0) = Eigen::Vector2d(1, 0);
    jacobians->by_interior.col(kY0) = Eigen::Vector2d(0, 1);
    // Measured direction: image + d(image, p) = const  =>  d image = -J^-1 dd/dp dp.
    jacobians->by_interior.rightCols<7>() =
        measured ? Eigen::Matrix<double, 2, 7>(-by_ideal * by_parameters) : by_parameters;
  }
  return Eigen::Vector2d(image + camera.principal_point_px());
}

}  // namespace

std::optional<Eigen::Vector2d> Project(const Camera& camera, const Eigen::Vector3d& point_in_cam,
                                       ProjectionJacobians* jacobians) {
  return ProjectFrom(camera, point_in_cam, nullptr, jacobians);
}

std::optional<Eigen::Vector2d> ProjectNear(const Camera& camera,
                                           const Eigen::Vector3d& point_in_cam,
                                           const Eigen::Vector2d& near_px,
                                           ProjectionJacobians* jacobians) {
  return ProjectFrom(camera, point_in_cam, &near_px, jacobians);
}

std::optional<Eigen::Vector2d> ProjectNear(const Camera& camera,
                                           const Eigen::Vector3d& point_in_cam,
                                           const Eigen::Vector2d& near_px,
                                           Eigen::Matrix<double, 2, 3>* by_point) {
  const double z = point_in_cam.z();
  if (!(z > 0)) return std::nullopt;
  const double scale = camera.f_px() / z;
  const Eigen::Vector2d ideal = scale * point_in_cam.head<2>();
  if (!ideal.allFinite()) return std::nullopt;
  Eigen::Vector2d image;
  Eigen::Matrix2d by_ideal;
  if (camera.direction == DistortionDirection::kMeasured) {
    const auto inverse = InvertNear(camera, ideal, near_px - camera.principal_point_px());
    if (!inverse) return std::nullopt;
    image = inverse->point_px;
    by_ideal = inverse->jacobian.inverse();
  } else {
    Eigen::Matrix2d slope;
    image = ideal + Distortion(camera, ideal, &slope);
    by_ideal = Eigen::Matrix2d::Identity() + slope;
    if (!(by_ideal.determinant() > 0)) return std::nullopt;
  }
  Eigen::Matrix<double, 2, 3> ideal_by_point;
  ideal_by_point << scale, 0, -ideal.x() / z, 0, scale, -ideal.y() / z;
  *by_point = by_ideal * ideal_by_point;
  return Eigen::Vector2d(image + camera.principal_point_px());
}

std::optional<Eigen::Vector2d> Undistort(const Camera& camera, const Eigen::Vector2d& pixel) {
  const Eigen::Vector2d image = pixel - camera.principal_point_px();
  if (!image.allFinite()) return std::nullopt;
  if (camera.direction == DistortionDirection::kMeasured) {
    return Eigen::Vector2d(image + Distortion(camera, image));
  }
  const std::optional<Inverse> inverse = InvertDistortion(camera, image);
  if (!inverse) return std::nullopt;
  return inverse->point_px;
}

std::optional<Eigen::Vector3d> RayThroughPixel(const Camera& camera, const Eigen::Vector2d& pixel,
                                               Eigen::Matrix2d* by_pixel) {
  const std::optional<Eigen::Vector2d> ideal = Undistort(camera, pixel);
  if (!ideal) return std::nullopt;
  const double f = camera.f_px();
  if (by_pixel != nullptr) {
    const bool measured = camera.direction == DistortionDirection::kMeasured;
    const Eigen::Vector2d at =
        measured ? Eigen::Vector2d(pixel - camera.principal_point_px()) : *ideal;
    Eigen::Matrix2d by_point;
    Distortion(camera, at, &by_point);
    const Eigen::Matrix2d jacobian = Eigen::Matrix2d::Identity() + by_point;
    *by_pixel = (measured ? jacobian : Eigen::Matrix2d(jacobian.inverse())) / f;
  }
  return Eigen::Vector3d(ideal->x() / f, ideal->y() / f, 1.0);
}

}  // namespace videogrammetry
