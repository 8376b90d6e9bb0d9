#include "videogrammetry/matching/candidates.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <tuple>
#include <utility>

namespace videogrammetry {
namespace {

// Before looking: four of five targets are seen by another camera too.
const double kLogPriorOdds = std::log(0.8 / 0.2);

// Upper limit of chi2 with d degrees of freedom at the two-sided level of the
// normal quantile z: Wilson-Hilferty (1931), good to a per cent here.
double ChiSquareLimit(int dof, double z) {
  if (dof == 1) return z * z;
  // One-sided normal quantile of the same level, for z in the range used.
  const double level = std::erfc(z / std::numbers::sqrt2);
  double one_sided = z;
  for (int i = 0; i < 30; ++i) {
    const double p = 0.5 * std::erfc(one_sided / std::numbers::sqrt2);
    const double slope = std::exp(-0.5 * one_sided * one_sided) / std::sqrt(2 * std::numbers::pi);
    one_sided += (p - level) / slope;
  }
  const double k = 2.0 / (9.0 * dof);
  return dof * std::pow(1.0 - k + one_sided * std::sqrt(k), 3);
}

// A camera's targets as rays in its own normalised picture.
struct NormalisedCamera {
  std::vector<Eigen::Vector3d> ray;  // (X/Z, Y/Z, 1)
  std::vector<Eigen::Matrix2d> cov;  // of the first two
  std::vector<char> valid;
};

NormalisedCamera Normalise(const OrientedCamera& oriented, const CameraTargets& targets) {
  NormalisedCamera normalised;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    Eigen::Matrix2d by_pixel = Eigen::Matrix2d::Zero();
    const auto ray = RayThroughPixel(oriented.camera, targets.xy_px[i], &by_pixel);
    normalised.valid.push_back(ray.has_value());
    normalised.ray.push_back(ray.value_or(Eigen::Vector3d(0, 0, 1)));
    normalised.cov.push_back(by_pixel * targets.cov_px2[i] * by_pixel.transpose());
  }
  return normalised;
}

// x_b^T E x_a = 0 for b_from_a = (R, t): E = [t]_x R.
Eigen::Matrix3d EssentialMatrix(const Rigid3& b_from_a) {
  const Eigen::Vector3d& t = b_from_a.translation_mm;
  Eigen::Matrix3d cross;
  cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  return cross * b_from_a.rotation;
}

// A camera's targets as rays of the world's frame; behind a window refracted.
struct WorldRays {
  std::vector<Ray> ray;
  std::vector<Eigen::Matrix<double, 3, 2>> origin_by_pixel, direction_by_pixel;
};

WorldRays RaysOf(const OrientedCamera& oriented, const CameraTargets& targets,
                 std::vector<char>* valid) {
  WorldRays rays;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    Eigen::Matrix<double, 3, 2> direction, origin;
    const auto ray = RayFromPixel(oriented, targets.xy_px[i], &direction, &origin);
    (*valid)[i] = (*valid)[i] && ray.has_value();
    rays.ray.push_back(ray.value_or(Ray{}));
    rays.origin_by_pixel.push_back(ray ? origin : Eigen::Matrix<double, 3, 2>::Zero());
    rays.direction_by_pixel.push_back(ray ? direction : Eigen::Matrix<double, 3, 2>::Zero());
  }
  return rays;
}

// The two rays' miss (o_b - o_a) . (u_a x u_b), 0 of rays that meet, and its variance.
std::pair<double, double> Miss(const WorldRays& a, std::size_t i, const Eigen::Matrix2d& cov_a,
                               const WorldRays& b, std::size_t j, const Eigen::Matrix2d& cov_b) {
  const Eigen::Vector3d between = b.ray[j].origin_mm - a.ray[i].origin_mm;
  const Eigen::Vector3d across = a.ray[i].direction.cross(b.ray[j].direction);
  const Eigen::Vector2d by_a =
      a.direction_by_pixel[i].transpose() * b.ray[j].direction.cross(between) -
      a.origin_by_pixel[i].transpose() * across;
  const Eigen::Vector2d by_b =
      b.direction_by_pixel[j].transpose() * between.cross(a.ray[i].direction) +
      b.origin_by_pixel[j].transpose() * across;
  return {between.dot(across), by_a.dot(cov_a * by_a) + by_b.dot(cov_b * by_b)};
}

bool IdsAgree(int a, int b) { return a < 0 || b < 0 || a == b; }

class Finder {
 public:
  Finder(const Rig& rig, std::span<const CameraTargets> cameras,
         const std::vector<std::vector<char>>& free, const MatchingOptions& options)
      : rig_(rig), cameras_(cameras), free_(free), options_(options) {
    for (std::size_t c = 0; c < rig.size(); ++c) {
      normalised_.push_back(Normalise(rig[c], cameras[c]));
      refracted_.push_back(rig[c].interface ? 1 : 0);
    }
    // Rays through a window have no common centre and no epipolar line.
    if (std::find(refracted_.begin(), refracted_.end(), 1) == refracted_.end()) return;
    for (std::size_t c = 0; c < rig.size(); ++c) {
      rays_.push_back(RaysOf(rig[c], cameras[c], &normalised_[c].valid));
    }
  }

  std::vector<Candidate> Run() {
    for (std::size_t a = 0; a < rig_.size(); ++a) {
      for (std::size_t b = a + 1; b < rig_.size(); ++b) Pairs(a, b);
    }
    return std::move(found_);
  }

 private:
  void Pairs(std::size_t a, std::size_t b) {
    const Eigen::Matrix3d essential =
        EssentialMatrix(rig_[b].cam_from_world * rig_[a].cam_from_world.Inverse());
    const double gate = options_.critical_value * options_.critical_value;
    const bool refracted = refracted_[a] || refracted_[b];
    for (std::size_t i = 0; i < cameras_[a].size(); ++i) {
      if (!free_[a][i] || !normalised_[a].valid[i]) continue;
      const Eigen::Vector3d line_b = essential * normalised_[a].ray[i];
      for (std::size_t j = 0; j < cameras_[b].size(); ++j) {
        if (!free_[b][j] || !normalised_[b].valid[j]) continue;
        if (!IdsAgree(cameras_[a].id[i], cameras_[b].id[j])) continue;
        double distance = line_b.dot(normalised_[b].ray[j]), variance = 0.0;
        if (refracted) {
          std::tie(distance, variance) =
              Miss(rays_[a], i, cameras_[a].cov_px2[i], rays_[b], j, cameras_[b].cov_px2[j]);
        } else {
          const Eigen::Vector2d by_b = line_b.head<2>();
          const Eigen::Vector2d by_a = (essential.transpose() * normalised_[b].ray[j]).head<2>();
          variance =
              by_b.dot(normalised_[b].cov[j] * by_b) + by_a.dot(normalised_[a].cov[i] * by_a);
        }
        if (distance * distance > gate * variance) continue;
        std::vector<int> target(rig_.size(), -1);
        target[a] = static_cast<int>(i);
        target[b] = static_cast<int>(j);
        Candidate pair;
        if (!MakeCandidate(rig_, cameras_, target, options_, &pair)) continue;
        Extend(pair, 0);
        if (seen_.insert(pair.target).second) found_.push_back(std::move(pair));
      }
    }
  }

  // Adds targets of the cameras from `camera` on that see the point too.
  void Extend(const Candidate& candidate, std::size_t camera) {
    for (std::size_t c = camera; c < rig_.size(); ++c) {
      if (candidate.target[c] >= 0) continue;
      for (const int k : Near(candidate, c)) {
        std::vector<int> target = candidate.target;
        target[c] = k;
        if (seen_.contains(target)) continue;
        Candidate larger;
        if (!MakeCandidate(rig_, cameras_, target, options_, &larger)) continue;
        Extend(larger, c + 1);
        seen_.insert(target);
        found_.push_back(std::move(larger));
      }
    }
  }

  // The two free targets nearest to the point's picture, within the gate.
  std::vector<int> Near(const Candidate& candidate, std::size_t c) const {
    OrientedJacobians jacobians;
    const auto pixel = ProjectFromWorld(rig_[c], candidate.point.position_mm, &jacobians);
    if (!pixel) return {};
    const Eigen::Matrix2d predicted =
        jacobians.by_point * candidate.point.cov_mm2 * jacobians.by_point.transpose();
    const double gate = options_.critical_value * options_.critical_value + 2.0;
    std::vector<std::pair<double, int>> near;
    for (std::size_t k = 0; k < cameras_[c].size(); ++k) {
      if (!free_[c][k] || !IdsAgree(candidate.id, cameras_[c].id[k])) continue;
      const Eigen::Vector2d difference = cameras_[c].xy_px[k] - *pixel;
      const Eigen::Matrix2d total = predicted + cameras_[c].cov_px2[k];
      const double distance = difference.dot(total.inverse() * difference);
      if (distance < gate) near.emplace_back(distance, static_cast<int>(k));
    }
    std::sort(near.begin(), near.end());
    std::vector<int> indices;
    for (std::size_t i = 0; i < std::min<std::size_t>(2, near.size()); ++i) {
      indices.push_back(near[i].second);
    }
    return indices;
  }

  const Rig& rig_;
  std::span<const CameraTargets> cameras_;
  const std::vector<std::vector<char>>& free_;
  const MatchingOptions& options_;
  std::vector<NormalisedCamera> normalised_;
  std::vector<char> refracted_;
  std::vector<WorldRays> rays_;  // empty without a window
  std::vector<Candidate> found_;
  std::set<std::vector<int>> seen_;
};

// Diameter of the dot in mm that each camera's ellipse implies: its major axis
// is not foreshortened, so 2 a Z / f agrees between the cameras.
bool SizesAgree(const Rig& rig, std::span<const CameraTargets> cameras, const Candidate& candidate,
                const MatchingOptions& options) {
  if (options.max_size_ratio <= 0) return true;
  double smallest = 0, largest = 0;
  for (std::size_t c = 0; c < rig.size(); ++c) {
    if (candidate.target[c] < 0) continue;
    const double a = cameras[c].semi_major_px[static_cast<std::size_t>(candidate.target[c])];
    if (!(a > 0)) continue;
    const double depth = (rig[c].cam_from_world * candidate.point.position_mm).z();
    const double size = a * depth / rig[c].camera.f_px();
    smallest = smallest == 0 ? size : std::min(smallest, size);
    largest = std::max(largest, size);
  }
  return largest <= options.max_size_ratio * smallest;
}

bool InRange(const Rig& rig, const Candidate& candidate, const MatchingOptions& options) {
  for (std::size_t c = 0; c < rig.size(); ++c) {
    if (candidate.target[c] < 0) continue;
    const double distance = (candidate.point.position_mm - rig[c].center_in_world()).norm();
    if (options.min_distance_mm > 0 && distance < options.min_distance_mm) return false;
    if (options.max_distance_mm > 0 && distance > options.max_distance_mm) return false;
  }
  return true;
}

double GeometricScore(const Rig& rig, std::span<const CameraTargets> cameras,
                      const Candidate& candidate, const std::vector<Sighting>& sightings) {
  const int n = candidate.num_cameras;
  double log_sigma = 0, log_density = 0, log_length = 0;
  for (const Sighting& s : sightings) {
    const Camera& camera = rig[static_cast<std::size_t>(s.camera)].camera;
    const double area = static_cast<double>(camera.width_px) * camera.height_px;
    log_sigma += 0.25 * std::log(s.cov_px2.determinant());  // of one coordinate
    log_density +=
        std::log(static_cast<double>(cameras[static_cast<std::size_t>(s.camera)].size()) / area);
    log_length += 0.5 * std::log(area);
  }
  log_sigma /= n;
  log_density /= n;
  log_length /= n;
  const int dof = 2 * n - 3;
  const double log_root = 0.5 * std::log(2 * std::numbers::pi);
  return kLogPriorOdds - 0.5 * candidate.point.chi2 - dof * (log_root + log_sigma) -
         (n - 1) * log_density - log_length;
}

}  // namespace

bool MakeCandidate(const Rig& rig, std::span<const CameraTargets> cameras,
                   const std::vector<int>& target, const MatchingOptions& options,
                   Candidate* candidate) {
  candidate->target = target;
  candidate->id = -1;
  std::vector<Sighting> sightings;
  for (std::size_t c = 0; c < rig.size(); ++c) {
    if (target[c] < 0) continue;
    const auto k = static_cast<std::size_t>(target[c]);
    const int id = cameras[c].id[k];
    if (!IdsAgree(candidate->id, id)) return false;
    if (id >= 0) candidate->id = id;
    sightings.push_back({static_cast<int>(c), cameras[c].xy_px[k], cameras[c].cov_px2[k]});
  }
  candidate->num_cameras = static_cast<int>(sightings.size());
  if (Intersect(rig, sightings, &candidate->point) != IntersectionStatus::kOk) return false;
  const int dof = 2 * candidate->num_cameras - 3;
  if (candidate->point.chi2 > ChiSquareLimit(dof, options.critical_value)) return false;
  if (!InRange(rig, *candidate, options)) return false;
  if (!SizesAgree(rig, cameras, *candidate, options)) return false;
  candidate->geometric_score = GeometricScore(rig, cameras, *candidate, sightings);
  candidate->score = candidate->geometric_score;
  return true;
}

std::vector<Candidate> FindCandidates(const Rig& rig, std::span<const CameraTargets> cameras,
                                      const std::vector<std::vector<char>>& free,
                                      const MatchingOptions& options) {
  return Finder(rig, cameras, free, options).Run();
}

}  // namespace videogrammetry
