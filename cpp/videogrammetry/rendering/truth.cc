#include "videogrammetry/rendering/truth.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace videogrammetry {
namespace {

using Rim = std::array<Eigen::Vector2d, kRimPoints>;

Eigen::Vector3d OnCircle(const TargetPose& pose, double radius_mm, int k) {
  const double angle = 2 * std::numbers::pi * k / kRimPoints;
  return pose.center_mm +
         radius_mm * (std::cos(angle) * pose.x_axis + std::sin(angle) * pose.y_axis());
}

std::optional<Rim> ProjectCircle(const OrientedCamera& camera, const TargetPose& pose,
                                 double radius_mm) {
  Rim rim;
  for (int k = 0; k < kRimPoints; ++k) {
    const auto pixel = ProjectFromWorld(camera, OnCircle(pose, radius_mm, k));
    if (!pixel) return std::nullopt;
    rim[k] = *pixel;
  }
  return rim;
}

/// An ellipse as the picture of the unit circle: c + M (cos, sin).
struct AffineEllipse {
  Eigen::Vector2d center;
  Eigen::Matrix2d axes;

  Ellipse ToEllipse() const {
    const Eigen::Matrix2d inverse = axes.inverse();
    Eigen::Matrix3d conic;
    const Eigen::Matrix2d shape = inverse.transpose() * inverse;
    conic << shape, -shape * center, (-shape * center).transpose(),
        center.dot(shape * center) - 1.0;
    // Centred on its own centre, lest large coordinates eat digits.
    conic.topRightCorner<2, 1>().setZero();
    conic.bottomLeftCorner<1, 2>().setZero();
    conic(2, 2) = -1.0;
    Ellipse ellipse = EllipseFromConic(conic).value_or(Ellipse{});
    ellipse.x_px = center.x();
    ellipse.y_px = center.y();
    return ellipse;
  }
};

/// First harmonics of the rim: the start of the fit.
AffineEllipse StartOf(const Rim& rim) {
  AffineEllipse e{Eigen::Vector2d::Zero(), Eigen::Matrix2d::Zero()};
  for (int k = 0; k < kRimPoints; ++k) {
    const double angle = 2 * std::numbers::pi * k / kRimPoints;
    e.center += rim[k] / kRimPoints;
    e.axes.col(0) += rim[k] * (2 * std::cos(angle) / kRimPoints);
    e.axes.col(1) += rim[k] * (2 * std::sin(angle) / kRimPoints);
  }
  return e;
}

/// One Gauss-Newton step. In the frame where the ellipse is the unit circle a
/// point (q) lies |q| - 1 off it, and a change of centre and shape moves the
/// circle by d . (cos, sin) + (cos, sin) S (cos, sin)^T, S symmetric; w turns
/// that into px along the ellipse's normal.
/// @return the largest distance in px before the step.
double Refine(const Rim& rim, AffineEllipse* e) {
  const Eigen::Matrix2d inverse = e->axes.inverse();
  Eigen::Matrix<double, 5, 5> normal = Eigen::Matrix<double, 5, 5>::Zero();
  Eigen::Matrix<double, 5, 1> right = Eigen::Matrix<double, 5, 1>::Zero();
  double largest = 0;
  for (const Eigen::Vector2d& p : rim) {
    const Eigen::Vector2d q = inverse * (p - e->center);
    const double length = q.norm(), off = length - 1;
    const Eigen::Vector2d n = q / length;
    const double w = 1.0 / (inverse.transpose() * n).norm();
    Eigen::Matrix<double, 5, 1> row;
    row << n.x(), n.y(), n.x() * n.x(), n.x() * n.y(), n.y() * n.y();
    normal += w * w * row * row.transpose();
    right += w * w * off * row;
    largest = std::max(largest, std::abs(w * off));
  }
  const Eigen::Matrix<double, 5, 1> step = normal.ldlt().solve(right);
  Eigen::Matrix2d shape;
  shape << 1 + step[2], 0.5 * step[3], 0.5 * step[3], 1 + step[4];
  e->center += e->axes * step.head<2>();
  e->axes = e->axes * shape;
  return largest;
}

/// Whether the segment from the camera's centre to `point` meets the sticker.
bool Hides(const SceneTarget& target, const TargetPose& pose, const Eigen::Vector3d& camera_center,
           const Eigen::Vector3d& point) {
  const Eigen::Vector3d ray = point - camera_center;
  const double along = pose.normal.dot(ray);
  if (!(along < 0)) return false;  // its back, or seen edge on: nothing is painted
  const double t = pose.normal.dot(pose.center_mm - camera_center) / along;
  if (!(t > 0 && t < 1 - 1e-9)) return false;
  const Eigen::Vector3d from_center = camera_center + t * ray - pose.center_mm;
  const double u = from_center.dot(pose.x_axis), v = from_center.dot(pose.y_axis());
  return target.sticker == StickerShape::kSquare
             ? std::max(std::abs(u), std::abs(v)) < target.sticker_mm
             : std::hypot(u, v) < target.sticker_mm;
}

bool HidesPartOf(const SceneTarget& near, const TargetPose& near_pose, const SceneTarget& far,
                 const TargetPose& far_pose, const Eigen::Vector3d& camera_center) {
  if (Hides(near, near_pose, camera_center, far_pose.center_mm)) return true;
  for (const double radius : {far.radius_mm, far.marked_mm()}) {
    for (int k = 0; k < kRimPoints; ++k) {
      if (Hides(near, near_pose, camera_center, OnCircle(far_pose, radius, k))) return true;
    }
  }
  return false;
}

Visibility InPicture(const Camera& camera, const Rim& rim) {
  int inside = 0;
  for (const Eigen::Vector2d& p : rim) {
    inside += p.x() >= -0.5 && p.y() >= -0.5 && p.x() <= camera.width_px - 0.5 &&
              p.y() <= camera.height_px - 0.5;
  }
  if (inside == kRimPoints) return Visibility::kVisible;
  return inside == 0 ? Visibility::kOutside : Visibility::kCut;
}

TargetTruth AloneInPicture(const OrientedCamera& camera, const SceneTarget& target,
                           const TargetPose& pose) {
  TargetTruth truth;
  const Facing facing = FacingOf(camera, pose, target.marked_mm());
  if (facing != Facing::kFront) {
    truth.visibility = facing == Facing::kBehind ? Visibility::kBehind : Visibility::kFacingAway;
    return truth;
  }
  truth.visibility = Visibility::kOutside;
  const auto rim = ProjectCircle(camera, pose, target.marked_mm());
  const auto center = ProjectFromWorld(camera, pose.center_mm);
  if (!rim || !center) return truth;
  truth.circle_center_px = center;
  truth.ellipse = EllipseOfCircle(camera, pose, target.radius_mm, &truth.ellipse_error_px);
  truth.visibility = InPicture(camera.camera, *rim);
  return truth;
}

}  // namespace

std::optional<Ellipse> EllipseOfCircle(const OrientedCamera& camera, const TargetPose& pose,
                                       double radius_mm, double* error_px) {
  const auto rim = ProjectCircle(camera, pose, radius_mm);
  if (!rim) return std::nullopt;
  AffineEllipse ellipse = StartOf(*rim);
  double error = 0, before = -1;
  for (int i = 0; i < 20 && std::abs(error - before) > 1e-13; ++i) {
    before = error;
    error = Refine(*rim, &ellipse);
  }
  if (error_px != nullptr) *error_px = error;
  return ellipse.ToEllipse();
}

Facing FacingOf(const OrientedCamera& camera, const TargetPose& pose, double reach_mm) {
  const Eigen::Vector3d center = camera.cam_from_world * pose.center_mm;
  const Eigen::Vector3d normal = camera.cam_from_world.rotation * pose.normal;
  // The disc of radius reach spans reach * sin(angle of normal and axis) in depth.
  const double span = reach_mm * std::hypot(normal.x(), normal.y());
  if (!(center.z() - span > 0)) return Facing::kBehind;
  return normal.dot(center) < 0 ? Facing::kFront : Facing::kAway;
}

std::vector<TargetTruth> TruthOf(const OrientedCamera& camera,
                                 const std::vector<SceneTarget>& targets) {
  const std::size_t n = targets.size();
  std::vector<TargetTruth> truths(n);
  std::vector<TargetPose> poses(n);
  std::vector<double> reach(n);
  for (std::size_t i = 0; i < n; ++i) {
    poses[i] = PoseAt(targets[i], 0.5);
    truths[i] = AloneInPicture(camera, targets[i], poses[i]);
    reach[i] = targets[i].sticker == StickerShape::kSquare ? 1.4143 * targets[i].sticker_mm
                                                           : targets[i].sticker_mm;
  }
  const Eigen::Vector3d center = camera.center_in_world();
  for (std::size_t i = 0; i < n; ++i) {
    if (truths[i].visibility != Visibility::kVisible) continue;
    const Eigen::Vector3d ray = (poses[i].center_mm - center).normalized();
    for (std::size_t j = 0; j < n; ++j) {
      const Eigen::Vector3d to = poses[j].center_mm - center;
      const double depth = ray.dot(to);
      // Nearer, and its sphere near the cone about target i.
      if (j == i || depth <= -reach[j] || (to - depth * ray).norm() > reach[i] + reach[j]) continue;
      if (HidesPartOf(targets[j], poses[j], targets[i], poses[i], center)) {
        truths[i].visibility = Visibility::kOccluded;
        break;
      }
    }
  }
  return truths;
}

}  // namespace videogrammetry
