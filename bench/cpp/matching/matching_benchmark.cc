// Time of a stage: the full search, and a chunk of stages in which targets are
// predicted or coded; right and wrong matches stand beside it.
#include <benchmark/benchmark.h>

#include <numeric>
#include <random>

#include "videogrammetry/matching/match.h"

namespace videogrammetry {
namespace {

constexpr double kSigmaPx = 0.02;

Rig Square(int cameras) {
  Rig rig;
  for (int i = 0; i < cameras; ++i) {
    Camera camera{1280, 1024, {}, 500.0, DistortionDirection::kMeasured};
    camera.interior << 2500, 5, -4, -2e-8, 0, 0, 6e-8, -7e-7, 0, 0;
    const double angle = 2 * 3.14159265 * (i + 0.5) / cameras;
    const Eigen::Matrix3d rotation =
        RotationFromVector({0.25 * std::sin(angle), 0.35 * std::cos(angle), 0});
    rig.push_back({camera, Rigid3{rotation, {0, 0, 1000}}});
  }
  return rig;
}

struct Scene {
  std::vector<CameraTargets> cameras;
  std::vector<std::vector<int>> point;  // a camera, a target
};

Scene Picture(const Rig& rig, const std::vector<Eigen::Vector3d>& points, bool coded,
              std::mt19937* random) {
  std::normal_distribution<double> noise(0, kSigmaPx);
  Scene scene;
  for (const OrientedCamera& camera : rig) {
    std::vector<int> order(points.size());
    std::iota(order.begin(), order.end(), 0);
    std::shuffle(order.begin(), order.end(), *random);
    CameraTargets targets;
    scene.point.emplace_back();
    for (const int p : order) {
      const auto pixel = ProjectFromWorld(camera, points[static_cast<std::size_t>(p)]);
      if (!pixel) continue;
      targets.xy_px.push_back(*pixel + Eigen::Vector2d(noise(*random), noise(*random)));
      targets.cov_px2.push_back(kSigmaPx * kSigmaPx * Eigen::Matrix2d::Identity());
      targets.id.push_back(coded ? p + 1 : -1);
      targets.semi_major_px.push_back(2.0);
      scene.point.back().push_back(p);
    }
    scene.cameras.push_back(std::move(targets));
  }
  return scene;
}

std::vector<Eigen::Vector3d> Cloud(int n, std::mt19937* random) {
  std::uniform_real_distribution<double> one(-0.5, 0.5);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < n; ++i) {
    points.emplace_back(340 * one(*random), 280 * one(*random), 200 * one(*random));
  }
  return points;
}

void OneStage(benchmark::State& state) {
  std::mt19937 random(1);
  const Rig rig = Square(static_cast<int>(state.range(0)));
  const auto points = Cloud(static_cast<int>(state.range(1)), &random);
  const Scene scene = Picture(rig, points, state.range(2) != 0, &random);
  MatchResult result;
  for (auto _ : state) {
    result = MatchStage(rig, scene.cameras);
    benchmark::DoNotOptimize(result.matches.data());
  }
  int right = 0;
  for (const Match& match : result.matches) {
    int own = -1;
    bool same = true;
    for (std::size_t c = 0; c < rig.size(); ++c) {
      if (match.target[c] < 0) continue;
      const int p = scene.point[c][static_cast<std::size_t>(match.target[c])];
      same = same && (own < 0 || own == p);
      own = p;
    }
    right += same;
  }
  state.counters["right"] = right;
  state.counters["wrong"] = static_cast<double>(result.matches.size()) - right;
}
BENCHMARK(OneStage)
    ->ArgNames({"cameras", "points", "coded"})
    ->Args({4, 50, 1})
    ->Args({4, 50, 0})
    ->Args({4, 200, 0})
    ->Args({4, 500, 0})
    ->Args({4, 1000, 0})
    ->Args({3, 1000, 0})
    ->Args({2, 500, 0})
    ->Args({16, 200, 0})
    ->Args({64, 50, 0})
    ->Args({64, 200, 0})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace videogrammetry
