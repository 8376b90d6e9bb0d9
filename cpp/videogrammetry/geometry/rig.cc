#include "videogrammetry/geometry/rig.h"

namespace videogrammetry {
namespace {

/// ProjectFromWorld; the search for the picture begins at `near_px` where that is known.
std::optional<Eigen::Vector2d> ProjectFrom(const OrientedCamera& oriented,
                                           const Eigen::Vector3d& point_in_world,
                                           const Eigen::Vector2d* near_px,
                                           OrientedJacobians* jacobians) {
  const Rigid3& pose = oriented.cam_from_world;
  Eigen::Vector3d seen = point_in_world;
  RefractionJacobians window;
  if (oriented.interface) {
    const auto through =
        SeenThrough(*oriented.interface, point_in_world, oriented.center_in_world(),
                    jacobians != nullptr ? &window : nullptr);
    if (!through) return std::nullopt;
    seen = *through;
  }
  const Eigen::Vector3d rotated = pose.rotation * seen;
  ProjectionJacobians inner;
  const Eigen::Vector3d in_cam = rotated + pose.translation_mm;
  const auto pixel = near_px != nullptr ? ProjectNear(oriented.camera, in_cam, *near_px, &inner)
                                        : Project(oriented.camera, in_cam,
                                                  jacobians != nullptr ? &inner : nullptr);
  if (!pixel || jacobians == nullptr) return pixel;
  // x_in_cam = exp(w) R x + t: d x_in_cam / d w = -[R x]_x at w = 0.
  auto minus_cross = [](const Eigen::Vector3d& v) {
    Eigen::Matrix3d m;
    m << 0, v.z(), -v.y(), -v.z(), 0, v.x(), v.y(), -v.x(), 0;
    return m;
  };
  jacobians->by_point = inner.by_point * pose.rotation;
  jacobians->by_camera.leftCols<kNumInterior>() = inner.by_interior;
  jacobians->by_camera.middleCols<3>(kNumInterior) = inner.by_point * minus_cross(rotated);
  jacobians->by_camera.rightCols<3>() = inner.by_point;
  if (!oriented.interface) return pixel;
  // The point of the window moves with the camera's centre -R' t:
  //   dC = -R' [t] dw - R' dt.
  const Eigen::Matrix<double, 2, 3> by_center =
      jacobians->by_point * window.by_center * pose.rotation.transpose();
  jacobians->by_camera.middleCols<3>(kNumInterior) += by_center * minus_cross(pose.translation_mm);
  jacobians->by_camera.rightCols<3>() -= by_center;
  jacobians->by_point *= window.by_point;
  return pixel;
}

}  // namespace

std::optional<Eigen::Vector2d> ProjectFromWorld(const OrientedCamera& oriented,
                                                const Eigen::Vector3d& point_in_world,
                                                OrientedJacobians* jacobians) {
  return ProjectFrom(oriented, point_in_world, nullptr, jacobians);
}

std::optional<Eigen::Vector2d> ProjectFromWorld(const OrientedCamera& oriented,
                                                const Eigen::Vector3d& point_in_world,
                                                const Eigen::Vector2d& near_px,
                                                OrientedJacobians* jacobians) {
  return ProjectFrom(oriented, point_in_world, &near_px, jacobians);
}

std::optional<Eigen::Vector2d> ProjectFromWorld(const OrientedCamera& oriented,
                                                const Eigen::Vector3d& point_in_world,
                                                const Eigen::Vector2d& near_px,
                                                Eigen::Matrix<double, 2, 3>* by_point) {
  if (oriented.interface) {
    OrientedJacobians jacobians;
    const auto pixel = ProjectFromWorld(oriented, point_in_world, &jacobians);
    *by_point = jacobians.by_point;
    return pixel;
  }
  const Rigid3& pose = oriented.cam_from_world;
  Eigen::Matrix<double, 2, 3> by_point_in_cam;
  const auto pixel =
      ProjectNear(oriented.camera, pose.rotation * point_in_world + pose.translation_mm, near_px,
                  &by_point_in_cam);
  if (pixel) *by_point = by_point_in_cam * pose.rotation;
  return pixel;
}

std::optional<Ray> RayFromPixel(const OrientedCamera& oriented, const Eigen::Vector2d& pixel,
                                Eigen::Matrix<double, 3, 2>* direction_by_pixel,
                                Eigen::Matrix<double, 3, 2>* origin_by_pixel) {
  Eigen::Matrix2d by_pixel;
  const auto in_cam =
      RayThroughPixel(oriented.camera, pixel, direction_by_pixel != nullptr ? &by_pixel : nullptr);
  if (!in_cam) return std::nullopt;
  const Eigen::Matrix3d to_world = oriented.cam_from_world.rotation.transpose();
  const Eigen::Vector3d along = to_world * *in_cam;
  Ray ray{oriented.center_in_world(), along.normalized()};
  RayJacobians window;
  window.origin_by_direction.setZero();
  window.direction_by_direction =
      (Eigen::Matrix3d::Identity() - ray.direction * ray.direction.transpose()) / along.norm();
  if (oriented.interface) {
    const auto refracted = RefractRay(*oriented.interface, ray.origin_mm, along,
                                      direction_by_pixel != nullptr ? &window : nullptr);
    if (!refracted) return std::nullopt;
    ray = *refracted;
  }
  if (direction_by_pixel != nullptr) {
    const Eigen::Matrix<double, 3, 2> turned = to_world.leftCols<2>() * by_pixel;
    *direction_by_pixel = window.direction_by_direction * turned;
    if (origin_by_pixel != nullptr) *origin_by_pixel = window.origin_by_direction * turned;
  }
  return ray;
}

}  // namespace videogrammetry
