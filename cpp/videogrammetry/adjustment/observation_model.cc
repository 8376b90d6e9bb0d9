#include "videogrammetry/adjustment/observation_model.h"

namespace videogrammetry {
namespace {

// d(exp([w]) v)/dw at w = 0 is -[v].
Eigen::Matrix3d MinusCross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, v.z(), -v.y(), -v.z(), 0, v.x(), v.y(), -v.x(), 0;
  return m;
}

/// Derivatives by the poses and the point, from those by the point in the camera's frame.
void Chain(const Eigen::Matrix<double, 2, 3>& by_cam, const Rigid3* outer, const Rigid3& inner,
           const Eigen::Vector3d& turned_outer, const Eigen::Vector3d& turned_inner,
           ImagePointJacobians* jacobians) {
  Eigen::Matrix<double, 2, 3> by_rig = by_cam;
  if (outer != nullptr) {
    jacobians->by_outer.leftCols<3>() = by_cam * MinusCross(turned_outer);
    jacobians->by_outer.rightCols<3>() = by_cam;
    by_rig = by_cam * outer->rotation;
  }
  jacobians->by_inner.leftCols<3>() = by_rig * MinusCross(turned_inner);
  jacobians->by_inner.rightCols<3>() = by_rig;
  jacobians->by_point = by_rig * inner.rotation;
}

/// The lens' picture of a point behind a window, square pixels at the nominal moment.
std::optional<Eigen::Vector2d> RefractedPicture(const Camera& camera, const Rigid3* outer,
                                                const Rigid3& inner,
                                                const Eigen::Vector3d& point_mm,
                                                const FlatInterface& interface,
                                                ImagePointJacobians* jacobians) {
  // The window stands in the frame that the camera's pose leads from.
  const Rigid3& pose = outer != nullptr ? *outer : inner;
  const Eigen::Vector3d turned_inner = inner.rotation * point_mm;
  const Eigen::Vector3d point =
      outer != nullptr ? Eigen::Vector3d(turned_inner + inner.translation_mm) : point_mm;
  const Eigen::Vector3d center = pose.Inverse().translation_mm;
  RefractionJacobians window;
  const auto seen = SeenThrough(interface, point, center, jacobians != nullptr ? &window : nullptr);
  if (!seen) return std::nullopt;
  const Eigen::Vector3d turned = pose.rotation * *seen;
  if (jacobians == nullptr) return Project(camera, turned + pose.translation_mm);
  ProjectionJacobians projection;
  const auto pixel = Project(camera, turned + pose.translation_mm, &projection);
  if (!pixel) return std::nullopt;
  jacobians->by_camera.leftCols<kNumInterior>() = projection.by_interior;
  const Eigen::Matrix<double, 2, 3> by_seen = projection.by_point * pose.rotation;
  // By the camera's pose directly and by its centre, dC = -R' [t] dw - R' dt.
  const Eigen::Matrix<double, 2, 3> by_center =
      by_seen * window.by_center * pose.rotation.transpose();
  Eigen::Matrix<double, 2, 6>& by_pose =
      outer != nullptr ? jacobians->by_outer : jacobians->by_inner;
  by_pose.leftCols<3>() =
      projection.by_point * MinusCross(turned) + by_center * MinusCross(pose.translation_mm);
  by_pose.rightCols<3>() = projection.by_point - by_center;
  jacobians->by_point = by_seen * window.by_point;
  jacobians->by_normal = by_seen * window.by_normal;
  jacobians->by_distance = by_seen * window.by_distance;
  if (outer == nullptr) return pixel;
  jacobians->by_inner.leftCols<3>() = jacobians->by_point * MinusCross(turned_inner);
  jacobians->by_inner.rightCols<3>() = jacobians->by_point;
  jacobians->by_point *= inner.rotation;
  return pixel;
}

/// The lens' picture, square pixels at the nominal moment.
std::optional<Eigen::Vector2d> LensPicture(const Camera& camera, const Rigid3* outer,
                                           const Rigid3& inner, const Circle& mark,
                                           ImagePointJacobians* jacobians) {
  const Eigen::Vector3d turned_inner = inner.rotation * mark.center_mm;
  const Eigen::Vector3d in_rig = turned_inner + inner.translation_mm;
  Eigen::Vector3d turned_outer = in_rig;
  Eigen::Vector3d in_cam = in_rig;
  if (outer != nullptr) {
    turned_outer = outer->rotation * in_rig;
    in_cam = turned_outer + outer->translation_mm;
  }
  if (!(mark.radius_mm > 0)) {
    if (jacobians == nullptr) return Project(camera, in_cam);
    ProjectionJacobians projection;
    const std::optional<Eigen::Vector2d> pixel = Project(camera, in_cam, &projection);
    if (!pixel) return std::nullopt;
    jacobians->by_camera.leftCols<kNumInterior>() = projection.by_interior;
    Chain(projection.by_point, outer, inner, turned_outer, turned_inner, jacobians);
    return pixel;
  }
  // The normal turns with the poses, as the point does without their shifts.
  const Eigen::Vector3d normal_inner = inner.rotation * mark.normal;
  const Eigen::Vector3d normal =
      outer != nullptr ? Eigen::Vector3d(outer->rotation * normal_inner) : normal_inner;
  EllipseCenterJacobians ellipse;
  const std::optional<Eigen::Vector2d> pixel = ProjectEllipseCenter(
      camera, {in_cam, normal, mark.radius_mm}, jacobians != nullptr ? &ellipse : nullptr);
  if (!pixel || jacobians == nullptr) return pixel;
  jacobians->by_camera.leftCols<kNumInterior>() = ellipse.by_interior;
  Chain(ellipse.by_center, outer, inner, turned_outer, turned_inner, jacobians);
  Eigen::Matrix<double, 2, 3> by_rig = ellipse.by_normal;
  if (outer != nullptr) {
    jacobians->by_outer.leftCols<3>() += ellipse.by_normal * MinusCross(normal);
    by_rig = ellipse.by_normal * outer->rotation;
  }
  jacobians->by_inner.leftCols<3>() += by_rig * MinusCross(normal_inner);
  return pixel;
}

/// The ideal point of a pixel of the measured direction, with its derivatives.
struct Ideal {
  Eigen::Vector2d point_px;  ///< from the principal point, px of the width
  Eigen::Matrix2d by_pixel;
  Eigen::Matrix<double, 2, kNumCameraUnknowns> by_camera;

  Ideal(const Camera& camera, double aspect, const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d high(1.0, 1.0 + aspect);
    const Eigen::Vector2d from_centre_px = pixel - camera.principal_point_px();
    const Eigen::Vector2d square_px = high.cwiseProduct(from_centre_px);
    Eigen::Matrix2d by_square;
    Eigen::Matrix<double, 2, 7> by_parameters;
    point_px = square_px + Distortion(camera, square_px, &by_square, &by_parameters);
    by_square += Eigen::Matrix2d::Identity();
    by_pixel = by_square * high.asDiagonal();
    by_camera.setZero();
    by_camera.middleCols<2>(kX0) = -by_pixel;
    by_camera.middleCols<7>(kA1) = by_parameters;
    by_camera.col(kAspect) = by_square.col(1) * from_centre_px.y();
  }
};

}  // namespace

std::optional<Eigen::Vector2d> PredictImagePoint(const Camera& camera, const Rigid3* outer,
                                                 const Rigid3& inner, const Circle& mark,
                                                 const Sampling& sampling,
                                                 ImagePointJacobians* jacobians,
                                                 const FlatInterface* interface) {
  std::optional<Eigen::Vector2d> pixel =
      interface != nullptr
          ? RefractedPicture(camera, outer, inner, mark.center_mm, *interface, jacobians)
          : LensPicture(camera, outer, inner, mark, jacobians);
  if (!pixel) return std::nullopt;
  const double centre_y_px = camera.principal_point_px().y();
  const double shrink = 1.0 / (1.0 + sampling.aspect);
  const double from_centre_px = shrink * (pixel->y() - centre_y_px);
  if (jacobians != nullptr) {
    jacobians->by_camera.row(1) *= shrink;
    // y0 moves the lens' picture and the row that is counted from alike.
    jacobians->by_camera(1, kY0) = 1.0;
    jacobians->by_camera.col(kAspect) << 0.0, -shrink * from_centre_px;
    jacobians->by_camera.col(kTimeOffset) = sampling.velocity_px;
    if (outer != nullptr) jacobians->by_outer.row(1) *= shrink;
    jacobians->by_inner.row(1) *= shrink;
    jacobians->by_point.row(1) *= shrink;
    jacobians->by_normal.row(1) *= shrink;
    jacobians->by_distance[1] *= shrink;
  }
  pixel->y() = centre_y_px + from_centre_px;
  return *pixel + sampling.time_offset * sampling.velocity_px;
}

void CountFromCorrected(const Camera& camera, const Sampling& sampling,
                        const Eigen::Vector2d& xy_px, bool has_outer, Eigen::Vector2d* pixel,
                        ImagePointJacobians* jacobians) {
  const Eigen::Vector2d late = sampling.time_offset * sampling.velocity_px;
  const Ideal measured(camera, sampling.aspect, xy_px - late);
  const Ideal predicted(camera, sampling.aspect, *pixel - late);
  const double r2 = camera.r0_px * camera.r0_px;
  const Eigen::Vector3d powers(r2, r2 * r2, r2 * r2 * r2);
  const double middle = 1.0 - camera.interior.segment<3>(kA1).dot(powers);
  const double unit = 1.0 / (middle * (1.0 + sampling.aspect));  // pixel heights
  const Eigen::Vector2d residual = unit * (measured.point_px - predicted.point_px);
  *pixel = xy_px - residual;
  if (jacobians == nullptr) return;
  const Eigen::Matrix2d by_pixel = unit * predicted.by_pixel;
  jacobians->by_camera.col(kTimeOffset) -= sampling.velocity_px;
  jacobians->by_camera =
      by_pixel * jacobians->by_camera - unit * (measured.by_camera - predicted.by_camera);
  jacobians->by_camera.col(kTimeOffset) += unit * measured.by_pixel * sampling.velocity_px;
  jacobians->by_camera.middleCols<3>(kA1) -= residual * (powers / middle).transpose();
  jacobians->by_camera.col(kAspect) += residual / (1.0 + sampling.aspect);
  if (has_outer) jacobians->by_outer = by_pixel * jacobians->by_outer;
  jacobians->by_inner = by_pixel * jacobians->by_inner;
  jacobians->by_point = by_pixel * jacobians->by_point;
}

std::optional<Eigen::Vector2d> PredictObservation(const Network& network,
                                                  const NetworkObservation& o,
                                                  ImagePointJacobians* jacobians) {
  auto pixel = PredictImagePoint(network, o.image, o.point, o.velocity_px, jacobians);
  const NetworkImage& image = network.images[o.image];
  const NetworkCamera& camera = network.cameras[image.camera];
  if (pixel && camera.corrected_residual) {
    CountFromCorrected(camera.camera, {camera.aspect, camera.time_offset, o.velocity_px}, o.xy_px,
                       image.outer >= 0, &*pixel, jacobians);
  }
  return pixel;
}

std::optional<Eigen::Vector2d> PredictImagePoint(const Network& network, int image_index, int point,
                                                 const Eigen::Vector2d& velocity_px,
                                                 ImagePointJacobians* jacobians) {
  const NetworkImage& image = network.images[image_index];
  const NetworkCamera& camera = network.cameras[image.camera];
  const Rigid3* outer = image.outer < 0 ? nullptr : &network.poses[image.outer].transform;
  const Rigid3& inner = network.poses[image.inner].transform;
  const Sampling sampling{camera.aspect, camera.time_offset, velocity_px};
  const Circle mark = network.points[point].mark();
  if (camera.interface < 0) {
    return PredictImagePoint(camera.camera, outer, inner, mark, sampling, jacobians);
  }
  const FlatInterface interface = network.interfaces[camera.interface].surface();
  return PredictImagePoint(camera.camera, outer, inner, mark, sampling, jacobians, &interface);
}

}  // namespace videogrammetry
