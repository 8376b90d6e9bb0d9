#include "videogrammetry/adjustment/observation_model.h"

namespace videogrammetry {
namespace {

// d(exp([w]) v)/dw at w = 0 is -[v].
Eigen::Matrix3d MinusCross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, v.z(), -v.y(), -v.z(), 0, v.x(), v.y(), -v.x(), 0;
  return m;
}

}  // namespace

std::optional<Eigen::Vector2d> PredictImagePoint(const Camera& camera, const Rigid3* outer,
                                                 const Rigid3& inner,
                                                 const Eigen::Vector3d& point_mm,
                                                 ImagePointJacobians* jacobians) {
  const Eigen::Vector3d turned_inner = inner.rotation * point_mm;
  const Eigen::Vector3d in_rig = turned_inner + inner.translation_mm;
  Eigen::Vector3d turned_outer = in_rig;
  Eigen::Vector3d in_cam = in_rig;
  if (outer != nullptr) {
    turned_outer = outer->rotation * in_rig;
    in_cam = turned_outer + outer->translation_mm;
  }
  if (jacobians == nullptr) return Project(camera, in_cam);

  ProjectionJacobians projection;
  const std::optional<Eigen::Vector2d> pixel = Project(camera, in_cam, &projection);
  if (!pixel) return std::nullopt;
  jacobians->by_interior = projection.by_interior;
  Eigen::Matrix<double, 2, 3> by_rig = projection.by_point;
  if (outer != nullptr) {
    jacobians->by_outer.leftCols<3>() = projection.by_point * MinusCross(turned_outer);
    jacobians->by_outer.rightCols<3>() = projection.by_point;
    by_rig = projection.by_point * outer->rotation;
  }
  jacobians->by_inner.leftCols<3>() = by_rig * MinusCross(turned_inner);
  jacobians->by_inner.rightCols<3>() = by_rig;
  jacobians->by_point = by_rig * inner.rotation;
  return pixel;
}

}  // namespace videogrammetry
