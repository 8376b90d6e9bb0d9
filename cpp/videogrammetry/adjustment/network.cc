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

Eigen::Matrix<double, 3, 2> NetworkInterface::Tangents() const {
  const Eigen::Vector3d& n = nominal.normal;
  Eigen::Index axis = 0;
  n.cwiseAbs().minCoeff(&axis);
  Eigen::Matrix<double, 3, 2> tangents;
  tangents.col(0) = (Eigen::Vector3d::Unit(axis) - n[axis] * n).normalized();
  tangents.col(1) = n.cross(tangents.col(0));
  return tangents;
}

FlatInterface NetworkInterface::surface(Eigen::Matrix<double, 3, 2>* normal_by_tilt) const {
  const Eigen::Matrix<double, 3, 2> tangents = Tangents();
  const Eigen::Vector3d turned = nominal.normal + tangents * tilt;
  const double length = turned.norm();
  FlatInterface surface = nominal;
  surface.normal = turned / length;
  surface.distance_mm = distance_mm;
  if (normal_by_tilt != nullptr) {
    *normal_by_tilt =
        (tangents - surface.normal * (surface.normal.transpose() * tangents)) / length;
  }
  return surface;
}

void Network::Check() const {
  for (const NetworkInterface& i : interfaces) {
    i.surface().Check(("Network: interface " + i.name).c_str());
  }
  for (const NetworkCamera& c : cameras) {
    Require(c.camera.interior.allFinite() && c.camera.f_px() > 0,
            "camera " + c.name + ": f must be positive and every parameter finite");
    Require(c.camera.r0_px > 0, "camera " + c.name + ": r0_px must be positive");
    Require(c.interface == -1 || InRange(c.interface, interfaces.size()),
            "camera " + c.name + ": no such interface");
    Require(c.interface == -1 || datum != Datum::kFree,
            "camera " + c.name + " looks through an interface: a free network's datum would " +
                "move it; use weighted or fixed points");
    Require(c.aspect > -1 && std::isfinite(c.aspect) && std::isfinite(c.time_offset),
            "camera " + c.name + ": aspect must exceed -1, time_offset be finite");
  }
  for (const NetworkPose& p : poses) {
    Require(p.transform.rotation.allFinite() && p.transform.translation_mm.allFinite(),
            "pose " + p.name + " is not finite");
  }
  for (const NetworkCamera& c : cameras) {
    Require(!c.corrected_residual || c.camera.direction == DistortionDirection::kMeasured,
            "camera " + c.name + ": only the measured direction corrects image points");
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
    if (prior_block.contains(static_cast<int>(&p - points.data()))) continue;
    Require(p.prior_mm.allFinite() && p.prior_cov_mm2.llt().info() == Eigen::Success,
            "point " + std::to_string(p.id) + ": its covariance is not positive definite");
  }
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const NetworkObservation& o = observations[i];
    const std::string name = "observation " + std::to_string(i);
    Require(InRange(o.image, images.size()), name + ": no such image");
    Require(InRange(o.point, points.size()), name + ": no such point");
    Require(o.xy_px.allFinite() && o.velocity_px.allFinite(), name + " is not finite");
    Require(TotalCov(o).llt().info() == Eigen::Success,
            name + ": its covariance is not positive definite");
  }
  for (std::size_t i = 0; i < scale_bars.size(); ++i) {
    const NetworkScaleBar& bar = scale_bars[i];
    const std::string name = "scale bar " + std::to_string(i);
    Require(InRange(bar.a, points.size()) && InRange(bar.b, points.size()) && bar.a != bar.b,
            name + ": it must join two different points of the network");
    Require(bar.length_mm > 0 && bar.sigma_mm > 0 && std::isfinite(bar.length_mm) &&
                std::isfinite(bar.sigma_mm),
            name + ": length and standard deviation must be positive");
  }
}

InteriorVector InteriorScale(const Camera& camera) {
  const double r = camera.r0_px, r2 = r * r;
  InteriorVector scale;
  scale << 1, 1, 1, 1 / r2, 1 / (r2 * r2), 1 / (r2 * r2 * r2), 1 / r, 1 / r, 1, 1;
  return scale;
}

CameraVector CameraScale(const Camera& camera) {
  CameraVector scale;
  scale << InteriorScale(camera), 1.0, 1.0;
  return scale;
}

const char* CameraUnknownName(int unknown) {
  if (unknown == kAspect) return "aspect";
  return unknown == kTimeOffset ? "time_offset" : kInteriorNames.at(unknown);
}

const char* InterfaceUnknownName(int unknown) {
  static constexpr std::array<const char*, kNumInterfaceUnknowns> kNames = {"tilt_1", "tilt_2",
                                                                            "distance"};
  return kNames.at(static_cast<std::size_t>(unknown));
}

CameraVector NetworkCamera::values() const {
  CameraVector all;
  all << camera.interior, aspect, time_offset;
  return all;
}

void NetworkCamera::set_values(const CameraVector& values) {
  camera.interior = values.head<kNumInterior>();
  aspect = values[kAspect];
  time_offset = values[kTimeOffset];
}

UnknownIndex::UnknownIndex(const Network& network) {
  for (const NetworkCamera& c : network.cameras) {
    std::array<int, kNumCameraUnknowns> place{};
    for (int k = 0; k < kNumCameraUnknowns; ++k) place[k] = c.free[k] ? num_unknowns++ : -1;
    camera.push_back(place);
  }
  for (const NetworkPose& p : network.poses) {
    pose.push_back(p.free ? num_unknowns : -1);
    if (p.free) num_unknowns += 6;
  }
  for (const NetworkInterface& i : network.interfaces) {
    std::array<int, kNumInterfaceUnknowns> place{};
    for (int k = 0; k < kNumInterfaceUnknowns; ++k) place[k] = i.free[k] ? num_unknowns++ : -1;
    interface.push_back(place);
  }
  num_orientation = num_unknowns;
  for (const NetworkPoint& p : network.points) {
    point.push_back(p.is_unknown() ? num_unknowns : -1);
    if (p.is_unknown()) num_unknowns += 3;
  }
}

void MoveUnknowns(const UnknownIndex& index, const Eigen::VectorXd& step, Network* network) {
  for (std::size_t c = 0; c < index.camera.size(); ++c) {
    CameraVector values = network->cameras[c].values();
    for (int k = 0; k < kNumCameraUnknowns; ++k) {
      if (index.camera[c][k] >= 0) values[k] += step[index.camera[c][k]];
    }
    network->cameras[c].set_values(values);
  }
  for (std::size_t p = 0; p < index.pose.size(); ++p) {
    if (index.pose[p] < 0) continue;
    Rigid3& pose = network->poses[p].transform;
    pose.rotation = RotationFromVector(step.segment<3>(index.pose[p])) * pose.rotation;
    pose.translation_mm += step.segment<3>(index.pose[p] + 3);
  }
  for (std::size_t i = 0; i < index.interface.size(); ++i) {
    Eigen::Vector3d values = network->interfaces[i].values();
    for (int k = 0; k < kNumInterfaceUnknowns; ++k) {
      if (index.interface[i][k] >= 0) values[k] += step[index.interface[i][k]];
    }
    network->interfaces[i].set_values(values);
  }
  for (std::size_t p = 0; p < index.point.size(); ++p) {
    if (index.point[p] >= 0) network->points[p].position_mm += step.segment<3>(index.point[p]);
  }
}

std::vector<std::string> UnknownNames(const Network& network, const UnknownIndex& index) {
  static constexpr std::array<const char*, 6> kPose = {" rx", " ry", " rz", " tx", " ty", " tz"};
  static constexpr std::array<const char*, 3> kPoint = {" x", " y", " z"};
  std::vector<std::string> names(static_cast<std::size_t>(index.num_unknowns));
  for (std::size_t c = 0; c < network.cameras.size(); ++c) {
    for (int k = 0; k < kNumCameraUnknowns; ++k) {
      const int u = index.camera[c][k];
      if (u >= 0) names[u] = network.cameras[c].name + " " + CameraUnknownName(k);
    }
  }
  for (std::size_t p = 0; p < network.poses.size(); ++p) {
    for (int k = 0; index.pose[p] >= 0 && k < 6; ++k) {
      names[index.pose[p] + k] = network.poses[p].name + kPose[k];
    }
  }
  for (std::size_t i = 0; i < network.interfaces.size(); ++i) {
    for (int k = 0; k < kNumInterfaceUnknowns; ++k) {
      const int u = index.interface[i][k];
      if (u >= 0) names[u] = network.interfaces[i].name + " " + InterfaceUnknownName(k);
    }
  }
  for (std::size_t p = 0; p < network.points.size(); ++p) {
    for (int k = 0; index.point[p] >= 0 && k < 3; ++k) {
      names[index.point[p] + k] = "point " + std::to_string(network.points[p].id) + kPoint[k];
    }
  }
  return names;
}

std::string UnknownName(const Network& network, const UnknownIndex& index, int unknown) {
  return UnknownNames(network, index).at(static_cast<std::size_t>(unknown));
}

}  // namespace videogrammetry
