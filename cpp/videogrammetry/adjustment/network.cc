#include "videogrammetry/adjustment/network.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <stdexcept>

namespace videogrammetry {
namespace {

void Require(bool condition, const std::string& what) {
  if (!condition) throw std::invalid_argument("Network: " + what);
}

bool InRange(int index, std::size_t size) {
  return index >= 0 && static_cast<std::size_t>(index) < size;
}

}  // namespace

Eigen::Matrix2d Network::TotalCov(const NetworkObservation& o) const {
  const NetworkCamera& camera = cameras[camera_of(o)];
  return camera.cov_scale * o.cov_px2 +
         camera.floor_px * camera.floor_px * Eigen::Matrix2d::Identity();
}

Rigid3 Network::CamFromObject(const NetworkImage& image) const {
  const Rigid3& inner = poses[image.inner].transform;
  return image.outer < 0 ? inner : poses[image.outer].transform * inner;
}

void Network::Check() const {
  for (const NetworkCamera& c : cameras) {
    Require(c.camera.interior.allFinite() && c.camera.f_px() > 0,
            "camera " + c.name + ": f must be positive and every parameter finite");
    Require(c.camera.r0_px > 0, "camera " + c.name + ": r0_px must be positive");
  }
  for (const NetworkPose& p : poses) {
    Require(p.transform.rotation.allFinite() && p.transform.translation_mm.allFinite(),
            "pose " + p.name + " is not finite");
  }
  for (const NetworkImage& i : images) {
    Require(InRange(i.camera, cameras.size()), "image " + i.name + ": no such camera");
    Require(i.outer == -1 || InRange(i.outer, poses.size()), "image " + i.name + ": no such pose");
    Require(InRange(i.inner, poses.size()), "image " + i.name + ": no such pose");
  }
  for (const NetworkPoint& p : points) {
    Require(p.position_mm.allFinite(), "point " + std::to_string(p.id) + " is not finite");
    if (p.radius_mm != 0) p.mark().Check(("Network: point " + std::to_string(p.id)).c_str());
    if (p.kind != PointKind::kWeighted) continue;
    Require(p.prior_mm.allFinite() && p.prior_cov_mm2.llt().info() == Eigen::Success,
            "point " + std::to_string(p.id) + ": its covariance is not positive definite");
  }
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const NetworkObservation& o = observations[i];
    const std::string name = "observation " + std::to_string(i);
    Require(InRange(o.image, images.size()), name + ": no such image");
    Require(InRange(o.point, points.size()), name + ": no such point");
    Require(o.xy_px.allFinite(), name + " is not finite");
    Require(TotalCov(o).llt().info() == Eigen::Success,
            name + ": its covariance is not positive definite");
  }
}

InteriorVector InteriorScale(const Camera& camera) {
  const double r = camera.r0_px, r2 = r * r;
  InteriorVector scale;
  scale << 1, 1, 1, 1 / r2, 1 / (r2 * r2), 1 / (r2 * r2 * r2), 1 / r, 1 / r, 1, 1;
  return scale;
}

UnknownIndex::UnknownIndex(const Network& network) {
  for (const NetworkCamera& camera : network.cameras) {
    std::array<int, kNumInterior> place{};
    for (int k = 0; k < kNumInterior; ++k) place[k] = camera.free[k] ? num_reduced++ : -1;
    interior.push_back(place);
  }
  for (const NetworkPose& p : network.poses) {
    pose.push_back(p.free ? num_reduced : -1);
    if (p.free) num_reduced += 6;
  }
  for (const NetworkPoint& p : network.points) {
    point.push_back(p.kind == PointKind::kFixed ? -1 : num_points++);
  }
}

std::string UnknownName(const Network& network, const UnknownIndex& index, int unknown) {
  static constexpr std::array<const char*, 6> kPose = {"rx", "ry", "rz", "tx", "ty", "tz"};
  for (std::size_t c = 0; c < network.cameras.size(); ++c) {
    for (int k = 0; k < kNumInterior; ++k) {
      if (index.interior[c][k] == unknown) {
        return network.cameras[c].name + " " + kInteriorNames[k];
      }
    }
  }
  for (std::size_t p = 0; p < network.poses.size(); ++p) {
    const int first = index.pose[p];
    if (first >= 0 && unknown >= first && unknown < first + 6) {
      return network.poses[p].name + " " + kPose[unknown - first];
    }
  }
  return "unknown " + std::to_string(unknown);
}

}  // namespace videogrammetry
