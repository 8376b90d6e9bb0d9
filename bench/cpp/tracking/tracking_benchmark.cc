// Time of a stage of tracking; numbers that change their point stand beside it.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <unordered_map>

#include "videogrammetry/tracking/tracker.h"

namespace videogrammetry {
namespace {

constexpr int kStages = 60, kFirstFree = 1000000;
constexpr double kSigmaMm = 0.05, kSpacingMm = 10.0;

struct Film {
  std::vector<std::vector<Eigen::Vector3d>> position_mm;  // a stage, in random order
  std::vector<std::vector<int>> truth;
};

void Shoot(const std::vector<Eigen::Vector3d>& points, const std::vector<int>& who, double unseen,
           std::mt19937* random, Film* film) {
  std::normal_distribution<double> noise(0, kSigmaMm);
  std::uniform_real_distribution<double> one;
  std::vector<std::size_t> order(points.size());
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), *random);
  film->position_mm.emplace_back();
  film->truth.emplace_back();
  for (const std::size_t p : order) {
    if (one(*random) < unseen) continue;
    film->position_mm.back().push_back(
        points[p] + Eigen::Vector3d(noise(*random), noise(*random), noise(*random)));
    film->truth.back().push_back(who[p]);
  }
}

double Side(int n) { return kSpacingMm * std::cbrt(n); }

std::vector<Eigen::Vector3d> Uniform(int n, std::mt19937* random) {
  std::uniform_real_distribution<double> place(0, Side(n));
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < n; ++i) points.emplace_back(place(*random), place(*random), place(*random));
  return points;
}

// A vortex that is a third of the spacing a stage fast at its rim; who leaves the cube comes in on
// the other side as another particle.
Film Flow(int n, double unseen) {
  std::mt19937 random(1);
  std::vector<Eigen::Vector3d> points = Uniform(n, &random);
  const double size = Side(n), turn = 2.0 / 3.0 * kSpacingMm / size;
  std::vector<int> who(points.size());
  std::iota(who.begin(), who.end(), 0);
  int next = n;
  Film film;
  for (int s = 0; s < kStages; ++s) {
    Shoot(points, who, unseen, &random, &film);
    for (std::size_t p = 0; p < points.size(); ++p) {
      const Eigen::Vector3d off = points[p] - Eigen::Vector3d::Constant(0.5 * size);
      points[p] += turn * Eigen::Vector3d(-off.y(), off.x(), 0.3 * off.x());
      if ((points[p].array() >= 0).all() && (points[p].array() <= size).all()) continue;
      for (int k = 0; k < 3; ++k) points[p][k] -= size * std::floor(points[p][k] / size);
      who[p] = next++;
    }
  }
  return film;
}

// Points that swing each for itself about places that stay.
Film Cloud(int n, double unseen) {
  std::mt19937 random(2);
  const std::vector<Eigen::Vector3d> middle = Uniform(n, &random);
  std::uniform_real_distribution<double> phase(0, 6.28);
  std::vector<Eigen::Vector3d> start;
  for (int i = 0; i < n; ++i) start.emplace_back(phase(random), phase(random), phase(random));
  std::vector<int> who(middle.size());
  std::iota(who.begin(), who.end(), 0);
  Film film;
  for (int s = 0; s < kStages; ++s) {
    std::vector<Eigen::Vector3d> points = middle;
    for (std::size_t p = 0; p < points.size(); ++p) {
      points[p] += 2.0 * kSpacingMm * (start[p].array() + 0.05 * s).sin().matrix();
    }
    Shoot(points, who, unseen, &random, &film);
  }
  return film;
}

void Track(benchmark::State& state, const Film& film) {
  std::vector<std::vector<int>> number;
  for (auto _ : state) {
    Tracker tracker(kFirstFree);
    number.clear();
    for (const auto& position_mm : film.position_mm) {
      const std::vector<int> id(position_mm.size(), -1);
      const std::vector<Eigen::Matrix3d> cov(position_mm.size(),
                                             kSigmaMm * kSigmaMm * Eigen::Matrix3d::Identity());
      StageLinks links = tracker.Add(id, position_mm, cov);
      for (const Rename& r : links.renames) {
        for (auto& stage : number) std::replace(stage.begin(), stage.end(), r.from, r.to);
      }
      for (const Revision& r : links.revisions) {
        number[static_cast<std::size_t>(r.stage)][static_cast<std::size_t>(r.row)] = r.number;
      }
      number.push_back(std::move(links.number));
    }
  }
  std::unordered_map<int, int> last;
  int changed = 0;
  for (std::size_t s = 0; s < number.size(); ++s) {
    for (std::size_t r = 0; r < number[s].size(); ++r) {
      const auto [entry, fresh] = last.try_emplace(number[s][r], film.truth[s][r]);
      changed += !fresh && entry->second != film.truth[s][r];
      entry->second = film.truth[s][r];
    }
  }
  state.counters["changed_point"] = changed;
  state.counters["us_a_stage"] = benchmark::Counter(
      1e-6 * kStages, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void TrackFlow(benchmark::State& state) {
  Track(state, Flow(static_cast<int>(state.range(0)), 0.01 * static_cast<double>(state.range(1))));
}
void TrackCloud(benchmark::State& state) {
  Track(state, Cloud(static_cast<int>(state.range(0)), 0.01 * static_cast<double>(state.range(1))));
}
BENCHMARK(TrackFlow)
    ->ArgNames({"points", "unseen_percent"})
    ->Args({1000, 0})
    ->Args({1000, 5})
    ->Unit(benchmark::kMillisecond);
BENCHMARK(TrackCloud)
    ->ArgNames({"points", "unseen_percent"})
    ->Args({50, 10})
    ->Args({1000, 10})
    ->Args({5000, 10})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace videogrammetry
