#include "videogrammetry/geometry/intersection.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <optional>

namespace videogrammetry {
namespace {

constexpr int kMaxIterations = 20;
// Rays within a microradian of parallel determine no depth at any range used.
constexpr double kMinConvergenceRad = 1e-6;
// In sigmas: below the first the point stays where it is, below the second residuals
// and weights follow from those before the step.
constexpr double kSmallStep = 1e-6;
constexpr double kLinearStep = 1e-2;

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
  // The tangents' squares, as fractions, rise as the angles do: one arc alone is needed.
  double sine2 = 0, cosine2 = 1;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    for (std::size_t j = i + 1; j < rays.size(); ++j) {
      const double s2 = rays[i].direction.cross(rays[j].direction).squaredNorm();
      const double c = rays[i].direction.dot(rays[j].direction), c2 = c * c;
      if (!(s2 * cosine2 > sine2 * c2)) continue;
      sine2 = s2;
      cosine2 = c2;
    }
  }
  return std::atan2(std::sqrt(sine2), std::sqrt(cosine2));
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
  return normal.inverse() * right;  // a start value
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
};

/// What is known of a sighting at the present place of the point.
struct Ray2d {
  Eigen::Matrix2d weight;
  Eigen::Vector2d near_px;  // about where its picture is
  Eigen::Vector2d residual_px;
  Eigen::Matrix<double, 2, 3> by_point;
};

bool Linearise(const Rig& rig, std::span<const Sighting> sightings, const Eigen::Vector3d& position,
               Linearised* system, std::vector<Ray2d>* rays) {
  *system = {};
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    Ray2d& ray = (*rays)[i];
    const auto pixel = ProjectFromWorld(rig[static_cast<std::size_t>(sightings[i].camera)],
                                        position, ray.near_px, &ray.by_point);
    if (!pixel) return false;
    ray.near_px = *pixel;
    ray.residual_px = sightings[i].pixel - *pixel;
    const Eigen::Matrix<double, 3, 2> weighted = ray.by_point.transpose() * ray.weight;
    system->normal.noalias() += weighted * ray.by_point;
    system->right.noalias() += weighted * ray.residual_px;
  }
  return true;
}

/// The point after a step so small that the linearisation holds.
IntersectionStatus Finish(const Eigen::Vector3d& position, const Eigen::Vector3d& step,
                          const Eigen::Matrix3d& cov_mm2, const std::vector<Ray2d>& rays,
                          double convergence_rad, Intersection* result) {
  result->position_mm = position;
  result->cov_mm2 = cov_mm2;
  result->convergence_rad = convergence_rad;
  result->chi2 = 0.0;
  result->residuals_px.resize(rays.size());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Eigen::Vector2d residual = rays[i].residual_px - rays[i].by_point * step;
    result->residuals_px[i] = residual;
    result->chi2 += residual.dot(rays[i].weight * residual);
  }
  return result->cov_mm2.allFinite() ? IntersectionStatus::kOk : IntersectionStatus::kNotConverged;
}

}  // namespace

IntersectionStatus Intersect(const Rig& rig, std::span<const Sighting> sightings,
                             Intersection* result) {
  if (sightings.size() < 2) return IntersectionStatus::kTooFewRays;
  thread_local std::vector<Ray> rays;  // so that no point costs an allocation
  if (!MakeRays(rig, sightings, true, &rays)) return IntersectionStatus::kNotConverged;
  const double convergence = LargestAngle(rays);
  if (!(convergence > kMinConvergenceRad)) return IntersectionStatus::kParallelRays;

  std::optional<Eigen::Vector3d> start = Start(rays);
  if (!start && HasWindow(rig, sightings) && MakeRays(rig, sightings, false, &rays)) {
    start = Start(rays);  // the point is on the cameras' side of the window
  }
  if (!start) return IntersectionStatus::kBehindCamera;
  Eigen::Vector3d position = *start;
  thread_local std::vector<Ray2d> lines;
  lines.resize(sightings.size());
  for (std::size_t i = 0; i < lines.size(); ++i) {
    lines[i].weight = sightings[i].cov_px2.inverse();
    lines[i].near_px = sightings[i].pixel;
  }

  Linearised system;
  double before = 0.0;
  for (int i = 0; i < kMaxIterations; ++i) {
    if (!Linearise(rig, sightings, position, &system, &lines)) {
      return IntersectionStatus::kBehindCamera;
    }
    const Eigen::Matrix3d cov = system.normal.inverse();
    const Eigen::Vector3d step = cov * system.right;
    if (!step.allFinite()) return IntersectionStatus::kNotConverged;
    position += step;
    // A step of a millionth of a sigma changes nothing that can be measured, be it
    // this one or the next, which is smaller by what this one was than the one before.
    const double size = std::sqrt(std::max(step.dot(system.normal * step), 0.0));
    if (size < kSmallStep || (i > 0 && size < kLinearStep && size * size < kSmallStep * before)) {
      return Finish(position, step, cov, lines, convergence, result);
    }
    before = size;
    for (Ray2d& ray : lines) ray.near_px += ray.by_point * step;
  }
  return IntersectionStatus::kNotConverged;
}

}  // namespace videogrammetry
