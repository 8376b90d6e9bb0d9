// Time of a stage: the full search, and a chunk of stages in which targets are
// predicted or coded; right and wrong matches stand beside it.
#include <benchmark/benchmark.h>

#include <random>

#include "matching/scene.h"
#include "videogrammetry/matching/match.h"
#include "videogrammetry/matching/stages.h"

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

PictureOptions Dots(bool coded, int points) {
  return {.sigma_px = kSigmaPx, .radius_mm = 0.8, .coded = coded ? points : 0};
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
  const Scene scene =
      Picture(rig, points, Dots(state.range(2) != 0, static_cast<int>(points.size())), &random);
  MatchResult result;
  for (auto _ : state) {
    result = MatchStage(rig, scene.cameras);
    benchmark::DoNotOptimize(result.matches.data());
  }
  const Count count = Judge(scene, result);
  state.counters["right"] = count.right;
  state.counters["wrong"] = count.wrong;
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

// A chunk of 500 stages; points fly on curves, 3 px a stage.
void ManyStages(benchmark::State& state) {
  constexpr int kStages = 500;
  std::mt19937 random(2);
  const Rig rig = Square(static_cast<int>(state.range(0)));
  const auto points = Cloud(static_cast<int>(state.range(1)), &random);
  std::uniform_real_distribution<double> phase(0, 6.28);
  std::vector<double> start;
  for (std::size_t p = 0; p < points.size(); ++p) start.push_back(phase(random));
  std::vector<FlatTargets> flat(rig.size());
  std::vector<std::vector<int>> truth(rig.size());
  for (FlatTargets& f : flat) f.offsets.push_back(0);
  for (int s = 0; s < kStages; ++s) {
    std::vector<Eigen::Vector3d> moved = points;
    for (std::size_t p = 0; p < moved.size(); ++p) {
      const double angle = start[p] + 0.03 * s;
      moved[p] += 30 * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0.5 * std::cos(angle));
    }
    const Scene scene =
        Picture(rig, moved, Dots(state.range(2) != 0, static_cast<int>(moved.size())), &random);
    for (std::size_t c = 0; c < rig.size(); ++c) {
      const CameraTargets& t = scene.cameras[c];
      CameraTargets& all = flat[c].targets;
      all.xy_px.insert(all.xy_px.end(), t.xy_px.begin(), t.xy_px.end());
      all.cov_px2.insert(all.cov_px2.end(), t.cov_px2.begin(), t.cov_px2.end());
      all.id.insert(all.id.end(), t.id.begin(), t.id.end());
      all.semi_major_px.insert(all.semi_major_px.end(), t.semi_major_px.begin(),
                               t.semi_major_px.end());
      truth[c].insert(truth[c].end(), scene.truth[c].begin(), scene.truth[c].end());
      flat[c].offsets.push_back(all.size());
    }
  }
  StageMatches result;
  for (auto _ : state) {
    result = MatchStages(rig, flat);
    benchmark::DoNotOptimize(result.id.data());
  }
  double right = 0;
  for (std::size_t s = 0; s < kStages; ++s) {
    for (std::size_t k = result.offsets[s]; k < result.offsets[s + 1]; ++k) {
      int own = -1;
      bool same = true;
      for (std::size_t c = 0; c < rig.size(); ++c) {
        const int t = result.target[k * rig.size() + c];
        if (t < 0) continue;
        const int p = truth[c][flat[c].offsets[s] + static_cast<std::size_t>(t)];
        same = same && (own < 0 || own == p);
        own = p;
      }
      right += same;
    }
  }
  state.counters["us_a_stage"] = benchmark::Counter(
      1e-6 * kStages, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
  state.counters["right_a_stage"] = right / kStages;
  state.counters["wrong_a_stage"] = (static_cast<double>(result.id.size()) - right) / kStages;
}
BENCHMARK(ManyStages)
    ->ArgNames({"cameras", "points", "coded"})
    ->Args({4, 50, 1})
    ->Args({4, 50, 0})
    ->Args({4, 500, 0})
    ->Args({2, 50, 0})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace videogrammetry
