#include "videogrammetry/adjustment/datum.h"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <cmath>
#include <vector>

namespace videogrammetry {
namespace {

/// Poses as (what they are used for) by observations that take part.
struct PoseUse {
  std::vector<bool> inner, outer;
  explicit PoseUse(const Network& network)
      : inner(network.poses.size(), false), outer(network.poses.size(), false) {
    for (const NetworkObservation& o : network.observations) {
      if (!o.used) continue;
      const NetworkImage& image = network.images[o.image];
      inner[image.inner] = true;
      if (image.outer >= 0) outer[image.outer] = true;
    }
  }
};

bool HasScale(const Network& network, const PoseUse& use) {
  for (const NetworkScaleBar& bar : network.scale_bars) {
    if (bar.used) return true;
  }
  for (std::size_t p = 0; p < network.poses.size(); ++p) {
    const NetworkPose& pose = network.poses[p];
    if (use.outer[p] && !pose.free && pose.transform.translation_mm.norm() > 0) return true;
  }
  return false;
}

}  // namespace

Eigen::Matrix<double, 3, 7> HelmertOfPoint(const Eigen::Vector3d& x) {
  Eigen::Matrix<double, 3, 7> g;
  g.leftCols<3>().setIdentity();
  g.middleCols<3>(3) << 0, x.z(), -x.y(), -x.z(), 0, x.x(), x.y(), -x.x(), 0;
  g.col(6) = x;
  return g;
}

int FreeDatumSize(const Network& network) {
  if (network.datum != Datum::kFree) return 0;
  const PoseUse use(network);
  for (std::size_t p = 0; p < network.poses.size(); ++p) {
    if (use.inner[p] && !network.poses[p].free) return 0;
  }
  std::vector<bool> seen(network.points.size(), false);
  for (const NetworkObservation& o : network.observations) {
    if (o.used) seen[o.point] = true;
  }
  for (std::size_t p = 0; p < network.points.size(); ++p) {
    const NetworkPoint& point = network.points[p];
    if (point.is_observed() || (seen[p] && point.kind == PointKind::kFixed)) return 0;
  }
  return HasScale(network, use) ? 6 : 7;
}

Eigen::MatrixXd DatumNullSpace(const Network& network, const UnknownIndex& index) {
  const int size = FreeDatumSize(network);
  Eigen::MatrixXd g = Eigen::MatrixXd::Zero(index.num_unknowns, size);
  if (size == 0) return g;
  const PoseUse use(network);
  for (std::size_t p = 0; p < network.poses.size(); ++p) {
    const int first = index.pose[p];
    if (first < 0) continue;
    const Rigid3& pose = network.poses[p].transform;
    if (use.inner[p]) {
      g.block<3, 3>(first, 3) = -pose.rotation;
      g.block<3, 3>(first + 3, 0) = -pose.rotation;
    }
    if (size == 7) g.block<3, 1>(first + 3, 6) = pose.translation_mm;
  }
  for (std::size_t p = 0; p < network.points.size(); ++p) {
    if (index.point[p] < 0) continue;
    g.middleRows<3>(index.point[p]) = HelmertOfPoint(network.points[p].position_mm).leftCols(size);
  }
  return g;
}

void FitToDatum(Network* network) {
  const int size = FreeDatumSize(*network);
  std::vector<const NetworkPoint*> points;
  for (const NetworkPoint& p : network->points) {
    if (p.is_unknown()) points.push_back(&p);
  }
  if (size == 0 || points.size() < 3) return;
  Eigen::Matrix3Xd from(3, points.size()), to(3, points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    from.col(static_cast<Eigen::Index>(i)) = points[i]->position_mm;
    to.col(static_cast<Eigen::Index>(i)) = points[i]->prior_mm;
  }
  const Eigen::Matrix4d fit = Eigen::umeyama(from, to, size == 7);
  const double scale = std::cbrt(fit.topLeftCorner<3, 3>().determinant());
  const Eigen::Matrix3d rotation = fit.topLeftCorner<3, 3>() / scale;
  const Eigen::Vector3d shift = fit.topRightCorner<3, 1>();
  const PoseUse use(*network);
  for (NetworkPoint& p : network->points) {
    if (!p.is_unknown()) continue;
    p.position_mm = scale * (rotation * p.position_mm) + shift;
    p.normal = rotation * p.normal;
  }
  for (std::size_t i = 0; i < network->poses.size(); ++i) {
    Rigid3& pose = network->poses[i].transform;
    if (!network->poses[i].free) continue;
    pose.translation_mm *= scale;
    if (!use.inner[i]) continue;
    pose.rotation = NearestRotation(pose.rotation * rotation.transpose());
    pose.translation_mm -= pose.rotation * shift;
  }
}

Eigen::MatrixXd Orthonormalised(const Eigen::MatrixXd& columns) {
  return Eigen::HouseholderQR<Eigen::MatrixXd>(columns).householderQ() *
         Eigen::MatrixXd::Identity(columns.rows(), columns.cols());
}

}  // namespace videogrammetry
