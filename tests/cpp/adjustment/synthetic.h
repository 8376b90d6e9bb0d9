#pragma once

#include <cmath>
#include <random>

#include "videogrammetry/adjustment/network.h"

// A small rig around a target with known truth, for the tests of this room.
namespace videogrammetry::synthetic {

inline double Normal(std::mt19937* random, double sigma) {
  return std::normal_distribution<double>(0.0, sigma)(*random);
}

inline double Uniform(std::mt19937* random, double half) {
  return std::uniform_real_distribution<double>(-half, half)(*random);
}

inline Eigen::Vector3d UniformVector(std::mt19937* random, double half) {
  return {Uniform(random, half), Uniform(random, half), Uniform(random, half)};
}

inline Camera MakeCamera(double f_px) {
  Camera camera;
  camera.width_px = 1024;
  camera.height_px = 1024;
  camera.r0_px = 400;
  camera.interior << f_px, 10, -7, 3e-8, -2e-14, 1e-20, 1e-7, -2e-7, 1e-4, -1e-4;
  return camera;
}

struct Options {
  int num_cameras = 2;
  int num_stages = 6;
  int num_points = 30;
  double relief_mm = 150;
  double f_px = 2000;
};

/// Truth without noise: pictures are exact, points weighted with 0.1 mm.
inline Network MakeRig(std::mt19937* random, const Options& options) {
  Network n;
  for (int c = 0; c < options.num_cameras; ++c) {
    NetworkCamera camera;
    camera.name = std::string("c").append(std::to_string(c));
    camera.camera = MakeCamera(options.f_px + 30 * c);
    camera.free.fill(true);
    camera.free[kA3] = camera.free[kA2] = false;
    camera.free[kAspect] = camera.free[kTimeOffset] = false;
    camera.start = camera.values();
    n.cameras.push_back(camera);
    const Eigen::Matrix3d turn = RotationFromVector({0.02 * c, 0.5 * c, 0.01 * c});
    // All look at (0, 0, 3000) from 3 m.
    const Eigen::Vector3d aim(0, 0, 3000);
    n.poses.push_back({camera.name, {turn, aim - turn * aim}, c > 0});
  }
  for (int s = 0; s < options.num_stages; ++s) {
    const std::string name = std::string("stage ").append(std::to_string(s + 1));
    n.poses.push_back({name,
                       {RotationFromVector(UniformVector(random, 0.6)),
                        Eigen::Vector3d(0, 0, 3000) + UniformVector(random, 200)},
                       true});
    for (int c = 0; c < options.num_cameras; ++c) {
      n.images.push_back({name, c, c, options.num_cameras + s});
    }
  }
  for (int p = 0; p < options.num_points; ++p) {
    NetworkPoint point;
    point.id = p;
    point.kind = PointKind::kWeighted;
    point.position_mm = {Uniform(random, 400), Uniform(random, 400),
                         Uniform(random, options.relief_mm)};
    point.prior_mm = point.position_mm;
    point.prior_cov_mm2 = 0.01 * Eigen::Matrix3d::Identity();
    n.points.push_back(point);
  }
  for (int i = 0; i < static_cast<int>(n.images.size()); ++i) {
    for (int p = 0; p < options.num_points; ++p) {
      const auto pixel = Project(n.cameras[n.images[i].camera].camera,
                                 n.CamFromObject(n.images[i]) * n.points[p].position_mm);
      if (!pixel) continue;
      n.observations.push_back({i, p, *pixel, 4e-4 * Eigen::Matrix2d::Identity()});
    }
  }
  return n;
}

/// Adds noise as the stated covariances say, to pictures and observed points.
inline void AddNoise(std::mt19937* random, Network* n) {
  for (NetworkObservation& o : n->observations) {
    for (int k = 0; k < 2; ++k) o.xy_px[k] += Normal(random, std::sqrt(o.cov_px2(k, k)));
  }
  for (NetworkPoint& p : n->points) {
    for (int k = 0; k < 3; ++k) p.prior_mm[k] += Normal(random, std::sqrt(p.prior_cov_mm2(k, k)));
  }
}

/// Moves every free unknown off its value.
inline void Disturb(std::mt19937* random, double share, Network* n) {
  for (NetworkCamera& c : n->cameras) {
    if (c.free[kF]) c.camera.interior[kF] *= 1 + 0.02 * share;
    if (c.free[kX0]) c.camera.interior[kX0] += 5 * share;
  }
  for (NetworkPose& p : n->poses) {
    if (!p.free) continue;
    p.transform.rotation =
        RotationFromVector(UniformVector(random, 0.02 * share)) * p.transform.rotation;
    p.transform.translation_mm += UniformVector(random, 20 * share);
  }
}

}  // namespace videogrammetry::synthetic
