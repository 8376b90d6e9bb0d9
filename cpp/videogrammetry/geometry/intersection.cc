#include "videogrammetry/geometry/intersection.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <optional>

namespace videogrammetry {
namespace {

constexpr int kMaxIterations = 20;
// Rays within a microradian of parallel determine no depth at any range used.
constexpr double kMinConvergenceRad = 1e-6;

bool HasWindow(const Rig& rig, std::span<const Sighting> sightings) {
  return std::any_of(sightings.begin(), sightings.end(), [&](const Sighting& s) {
    return rig[static_cast<std::size_t>(s.camera)].interface.has_value();
  });
}

/// The rays as they are behind the cameras' windows, or in front of them.
bool MakeRays(const Rig& rig, std::span<const Sighting> sightings, bool behind_windows,
              std::vector<Ray>* rays) {
  rays->clear();
  for (const Sighting& s : sightings) {
    const OrientedCamera& oriented = rig[static_cast<std::size_t>(s.camera)];
    const auto ray = behind_windows
                         ? RayFromPixel(oriented, s.pixel)
                         : RayFromPixel({oriented.camera, oriented.cam_from_world}, s.pixel);
    if (!ray) return false;
    rays->push_back(*ray);
  }
  return true;
}

double LargestAngle(const std::vector<Ray>& rays) {
  double largest = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    for (std::size_t j = i + 1; j < rays.size(); ++j) {
      largest = std::max(largest, std::atan2(rays[i].direction.cross(rays[j].direction).norm(),
                                             std::abs(rays[i].direction.dot(rays[j].direction))));
    }
  }
  return largest;
}

Eigen::Vector3d NearestPoint(const std::vector<Ray>& rays) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const Ray& ray : rays) {
    const Eigen::Matrix3d across =
        Eigen::Matrix3d::Identity() - ray.direction * ray.direction.transpose();
    normal += across;
    right += across * ray.origin_mm;
  }
  return normal.ldlt().solve(right);
}

/// The point nearest to the rays, before all of their origins.
std::optional<Eigen::Vector3d> Start(const std::vector<Ray>& rays) {
  const Eigen::Vector3d position = NearestPoint(rays);
  for (const Ray& ray : rays) {
    if (!(ray.direction.dot(position - ray.origin_mm) > 0)) return std::nullopt;
  }
  return position;
}

struct Linearised {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  double chi2 = 0.0;
};

bool Linearise(const Rig& rig, std::span<const Sighting> sightings,
               const std::vector<Eigen::Matrix2d>& weights, const Eigen::Vector3d& position,
               Linearised* system, std::vector<Eigen::Vector2d>* residuals) {
  *system = {};
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    OrientedJacobians jacobians;
    const auto pixel =
        ProjectFromWorld(rig[static_cast<std::size_t>(sightings[i].camera)], position, &jacobians);
    if (!pixel) return false;
    const Eigen::Vector2d residual = sightings[i].pixel - *pixel;
    const Eigen::Matrix<double, 3, 2> weighted = jacobians.by_point.transpose() * weights[i];
    system->normal += weighted * jacobians.by_point;
    system->right += weighted * residual;
    system->chi2 += residual.dot(weights[i] * residual);
    (*residuals)[i] = residual;
  }
  return true;
}

}  // namespace

IntersectionStatus Intersect(const Rig& rig, std::span<const Sighting> sightings,
                             Intersection* result) {
  if (sightings.size() < 2) return IntersectionStatus::kTooFewRays;
  std::vector<Ray> rays;
  if (!MakeRays(rig, sightings, true, &rays)) return IntersectionStatus::kNotConverged;
  const double convergence = LargestAngle(rays);
  if (!(convergence > kMinConvergenceRad)) return IntersectionStatus::kParallelRays;

  std::optional<Eigen::Vector3d> start = Start(rays);
  if (!start && HasWindow(rig, sightings) && MakeRays(rig, sightings, false, &rays)) {
    start = Start(rays);  // the point is on the cameras' side of the window
  }
  if (!start) return IntersectionStatus::kBehindCamera;
  Eigen::Vector3d position = *start;
  std::vector<Eigen::Matrix2d> weights;
  for (const Sighting& s : sightings) weights.push_back(s.cov_px2.inverse());

  Linearised system;
  std::vector<Eigen::Vector2d> residuals(sightings.size());
  for (int i = 0; i < kMaxIterations; ++i) {
    if (!Linearise(rig, sightings, weights, position, &system, &residuals)) {
      return IntersectionStatus::kBehindCamera;
    }
    const Eigen::LDLT<Eigen::Matrix3d> solver(system.normal);
    const Eigen::Vector3d step = solver.solve(system.right);
    if (!step.allFinite()) return IntersectionStatus::kNotConverged;
    position += step;
    // A step of a millionth of a sigma changes nothing that can be measured.
    if (step.dot(system.normal * step) < 1e-6 * 1e-6) {
      if (!Linearise(rig, sightings, weights, position, &system, &residuals)) {
        return IntersectionStatus::kBehindCamera;
      }
      result->position_mm = position;
      result->cov_mm2 = system.normal.inverse();
      result->chi2 = system.chi2;
      result->convergence_rad = convergence;
      result->residuals_px = std::move(residuals);
      return result->cov_mm2.allFinite() ? IntersectionStatus::kOk
                                         : IntersectionStatus::kNotConverged;
    }
  }
  return IntersectionStatus::kNotConverged;
}

}  // namespace videogrammetry
