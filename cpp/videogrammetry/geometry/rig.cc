#include "videogrammetry/geometry/rig.h"

namespace videogrammetry {

std::optional<Eigen::Vector2d> ProjectFromWorld(const OrientedCamera& oriented,
                                                const Eigen::Vector3d& point_in_world,
                                                OrientedJacobians* jacobians) {
  const Rigid3& pose = oriented.cam_from_world;
  const Eigen::Vector3d rotated = pose.rotation * point_in_world;
  ProjectionJacobians inner;
  const auto pixel = Project(oriented.camera, rotated + pose.translation_mm,
                             jacobians != nullptr ? &inner : nullptr);
  if (!pixel || jacobians == nullptr) return pixel;
  // x_in_cam = exp(w) R x + t: d x_in_cam / d w = -[R x]_x at w = 0.
  Eigen::Matrix3d by_rotation;
  by_rotation << 0, rotated.z(), -rotated.y(), -rotated.z(), 0, rotated.x(), rotated.y(),
      -rotated.x(), 0;
  jacobians->by_point = inner.by_point * pose.rotation;
  jacobians->by_camera.leftCols<kNumInterior>() = inner.by_interior;
  jacobians->by_camera.middleCols<3>(kNumInterior) = inner.by_point * by_rotation;
  jacobians->by_camera.rightCols<3>() = inner.by_point;
  return pixel;
}

}  // namespace videogrammetry
