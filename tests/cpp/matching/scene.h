#pragma once

// Pictures of known points, for the tests and the benchmark of matching.

#include <algorithm>
#include <numeric>
#include <random>
#include <vector>

#include "videogrammetry/matching/match.h"

namespace videogrammetry {

struct Scene {
  std::vector<CameraTargets> cameras;
  std::vector<std::vector<int>> truth;  // camera, target -> point
};

struct PictureOptions {
  double sigma_px = 0.05;   // of the centres
  double radius_mm = 20.0;  // of the dots
  int coded = 0;            // the first points have an ID
};

/// Noisy pictures in random order; what a camera does not see is not in its picture.
inline Scene Picture(const Rig& rig, const std::vector<Eigen::Vector3d>& points,
                     const PictureOptions& options, std::mt19937* random) {
  std::normal_distribution<double> noise(0, options.sigma_px);
  Scene scene;
  for (const OrientedCamera& oriented : rig) {
    std::vector<int> order(points.size());
    std::iota(order.begin(), order.end(), 0);
    std::shuffle(order.begin(), order.end(), *random);
    CameraTargets targets;
    std::vector<int> truth;
    for (const int p : order) {
      const Eigen::Vector3d& point = points[static_cast<std::size_t>(p)];
      const auto pixel = ProjectFromWorld(oriented, point);
      if (!pixel) continue;
      targets.xy_px.push_back(*pixel + Eigen::Vector2d(noise(*random), noise(*random)));
      targets.cov_px2.push_back(options.sigma_px * options.sigma_px * Eigen::Matrix2d::Identity());
      targets.id.push_back(p < options.coded ? p + 1 : -1);
      targets.semi_major_px.push_back(options.radius_mm * oriented.camera.f_px() /
                                      (oriented.cam_from_world * point).z());
      truth.push_back(p);
    }
    scene.cameras.push_back(std::move(targets));
    scene.truth.push_back(std::move(truth));
  }
  return scene;
}

/// The point whose targets these all are (a camera each, -1: none); -1 if they are of several.
inline int PointOf(const Scene& scene, const std::vector<int>& target) {
  int point = -1;
  for (std::size_t c = 0; c < target.size(); ++c) {
    if (target[c] < 0) continue;
    const int p = scene.truth[c][static_cast<std::size_t>(target[c])];
    if (point >= 0 && p != point) return -1;
    point = p;
  }
  return point;
}

struct Count {
  int right = 0, wrong = 0;
};

inline Count Judge(const Scene& scene, const MatchResult& result) {
  Count count;
  for (const Match& match : result.matches) {
    ++(PointOf(scene, match.target) >= 0 ? count.right : count.wrong);
  }
  return count;
}

}  // namespace videogrammetry
