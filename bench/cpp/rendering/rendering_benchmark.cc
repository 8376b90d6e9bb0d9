// Time of one 1024 x 1024 frame of 50 targets, dots of 8 to 20 px, one thread;
// beside it, as counters, the centroid's RMS and largest error against truth.

#include <benchmark/benchmark.h>

#include <cmath>
#include <random>

#include "videogrammetry/rendering/render.h"

namespace videogrammetry {
namespace {

constexpr double kDepth = 12000, kFocal = 2650;

OrientedCamera PaperCamera(DistortionDirection direction) {
  OrientedCamera camera;
  camera.camera.width_px = camera.camera.height_px = 1024;
  camera.camera.interior << kFocal, -40, 30, 1.2e-8, 3e-15, 1e-20, 2e-7, 3e-6, -0.0023, 3e-4;
  camera.camera.r0_px = 400;
  camera.camera.direction = direction;
  return camera;
}

/// 17 coded and 33 un-coded targets on a grid, tilted by 0 to 45 degrees.
std::vector<SceneTarget> FiftyTargets(bool moving) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform;
  std::vector<SceneTarget> targets;
  for (int k = 0; k < 50; ++k) {
    SceneTarget t;
    const double mm = kDepth / kFocal, x = (k % 7 - 3) * 130 + 40, y = (k / 7 - 3.5) * 120 - 30;
    const Eigen::Matrix3d turn =
        (Eigen::AngleAxisd(6.28 * uniform(random), Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(0.785 * uniform(random), Eigen::Vector3d::UnitX()))
            .toRotationMatrix();
    t.pose = {{x * mm, y * mm, kDepth}, -turn.col(2), turn.col(0)};
    t.radius_mm = (4 + 6 * uniform(random)) * mm;
    t.num_bits = k % 3 == 0 ? 14 : 0;
    t.code = 0b10010110111;
    t.sticker_mm = (k % 3 == 0 ? 3.5 : 2.0) * t.radius_mm;
    if (moving) {
      t.end_pose = t.pose;
      t.end_pose->center_mm.y() += 2 * mm;
    }
    targets.push_back(t);
  }
  return targets;
}

void Frame(benchmark::State& state, DistortionDirection direction, bool moving) {
  Background background;
  background.clutter = 0.3;
  Sensor sensor;
  sensor.bit_depth = 12;
  sensor.read_noise = 10;
  sensor.shot_noise_gain = 0.3;
  const Renderer renderer(PaperCamera(direction), background, {}, sensor);
  const auto targets = FiftyTargets(moving);
  std::vector<std::uint16_t> samples(1024 * 1024);
  std::uint64_t seed = 0;
  for (auto _ : state) {
    renderer.Render(targets, seed++, samples.data());
    benchmark::DoNotOptimize(samples.data());
  }
}
BENCHMARK_CAPTURE(Frame, measured, DistortionDirection::kMeasured, false)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(Frame, ideal, DistortionDirection::kIdeal, false)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(Frame, blurred_by_2_px, DistortionDirection::kMeasured, true)
    ->Unit(benchmark::kMillisecond);

void Paint(benchmark::State& state) {
  const Renderer renderer(PaperCamera(DistortionDirection::kMeasured), {}, {}, {});
  const auto targets = FiftyTargets(false);
  for (auto _ : state) benchmark::DoNotOptimize(renderer.Light(targets).data());
}
BENCHMARK(Paint)->Unit(benchmark::kMillisecond);

void Truth(benchmark::State& state) {
  const auto camera = PaperCamera(DistortionDirection::kMeasured);
  const auto targets = FiftyTargets(false);
  for (auto _ : state) benchmark::DoNotOptimize(TruthOf(camera, targets).data());
}
BENCHMARK(Truth)->Unit(benchmark::kMillisecond);

void NewRenderer(benchmark::State& state) {
  Background background;
  background.clutter = 0.3;
  for (auto _ : state) {
    const Renderer renderer(PaperCamera(DistortionDirection::kMeasured), background, {}, {});
    benchmark::DoNotOptimize(renderer.width());
  }
}
BENCHMARK(NewRenderer)->Unit(benchmark::kMillisecond);

/// The error of 64 x 64 pictures of a lone dot: centroid of the light against the ellipse's centre.
void LoneDotError(benchmark::State& state) {
  OrientedCamera camera;
  camera.camera.width_px = camera.camera.height_px = 64;
  camera.camera.interior[kF] = kFocal;
  Background dark;
  dark.level = 0.06;
  const Renderer renderer(camera, dark, {}, {});
  const double mm = kDepth / kFocal;
  double squares = 0, worst = 0;
  int count = 0;
  for (auto _ : state) {
    SceneTarget dot;
    dot.pose.center_mm = {(0.0831 * (count % 37) - 1) * mm, (0.0517 * (count % 41) - 1) * mm,
                          kDepth};
    dot.radius_mm = (4 + 0.1 * (count % 61)) * mm;
    dot.sticker_mm = 1.7 * dot.radius_mm;
    const auto light = renderer.Light({dot});
    double sum = 0, x = 0, y = 0;
    for (int i = 0; i < 64 * 64; ++i) {
      sum += light[i] - 0.06;
      x += (light[i] - 0.06) * (i % 64);
      y += (light[i] - 0.06) * (i / 64);
    }
    const Ellipse truth = *renderer.Truth({dot})[0].ellipse;
    const double dx = x / sum - truth.x_px, dy = y / sum - truth.y_px;
    squares += 0.5 * (dx * dx + dy * dy);
    worst = std::max(worst, std::hypot(dx, dy));
    ++count;
  }
  state.counters["rms_px"] = std::sqrt(squares / count);
  state.counters["worst_px"] = worst;
}
BENCHMARK(LoneDotError)->Iterations(2000)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace videogrammetry
