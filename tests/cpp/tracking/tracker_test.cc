#include "videogrammetry/tracking/tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <random>
#include <set>

namespace videogrammetry {
namespace {

constexpr int kFree = 500;
constexpr double kSigma = 0.05;

// Feeds a tracker and keeps what it says, with what it revises.
struct TrackedRun {
  explicit TrackedRun(unsigned seed, const LinkOptions& options = {})
      : tracker(kFree, options), random(seed) {}

  // Points of `truth` that are there, in random order; NaN is not there.
  void Add(const std::vector<Eigen::Vector3d>& truth, const std::vector<int>& codes = {},
           double occluded = 0.0) {
    std::vector<int> order;
    std::uniform_real_distribution<double> uniform;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      if (truth[i].allFinite() && uniform(random) >= occluded) order.push_back(static_cast<int>(i));
    }
    std::shuffle(order.begin(), order.end(), random);
    std::normal_distribution<double> noise(0.0, kSigma);
    std::vector<int> id;
    std::vector<Eigen::Vector3d> position;
    for (const int i : order) {
      id.push_back(codes.empty() ? -1 : codes[static_cast<std::size_t>(i)]);
      position.push_back(truth[static_cast<std::size_t>(i)] +
                         Eigen::Vector3d(noise(random), noise(random), noise(random)));
    }
    const std::vector<Eigen::Matrix3d> cov(id.size(),
                                           kSigma * kSigma * Eigen::Matrix3d::Identity());
    const StageLinks links = tracker.Add(id, position, cov);
    for (const Rename& r : links.renames) {
      for (auto& stage : numbers) std::replace(stage.begin(), stage.end(), r.from, r.to);
    }
    for (const Revision& r : links.revisions) {
      numbers[static_cast<std::size_t>(r.stage)][static_cast<std::size_t>(r.row)] = r.number;
    }
    numbers.push_back(links.number);
    log_odds.push_back(links.log_odds);
    who.push_back(order);
  }

  // Numbers that a point had, over all stages.
  std::set<int> NumbersOf(int point) const {
    std::set<int> all;
    for (std::size_t s = 0; s < who.size(); ++s) {
      for (std::size_t r = 0; r < who[s].size(); ++r) {
        if (who[s][r] == point) all.insert(numbers[s][r]);
      }
    }
    return all;
  }

  // Numbers that stood at two points, at each for three of their stages in a row.
  int Swapped() const {
    std::map<int, std::vector<int>> points;
    for (std::size_t s = 0; s < who.size(); ++s) {
      EXPECT_EQ(std::set<int>(numbers[s].begin(), numbers[s].end()).size(), numbers[s].size());
      for (std::size_t r = 0; r < who[s].size(); ++r) points[numbers[s][r]].push_back(who[s][r]);
    }
    int swapped = 0;
    for (const auto& [number, p] : points) {
      std::set<int> held;
      for (std::size_t k = 2; k < p.size(); ++k) {
        if (p[k] == p[k - 1] && p[k] == p[k - 2]) held.insert(p[k]);
      }
      swapped += held.size() > 1;
    }
    return swapped;
  }

  Tracker tracker;
  std::mt19937 random;
  std::vector<std::vector<int>> numbers, who;
  std::vector<std::vector<double>> log_odds;
};

// Pairs that swing about common places and pass through each other.
std::vector<Eigen::Vector3d> Pairs(int pairs, int stage, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform;
  std::normal_distribution<double> normal;
  std::vector<Eigen::Vector3d> points;
  for (int k = 0; k < pairs; ++k) {
    const Eigen::Vector3d centre(700 * uniform(random), 700 * uniform(random),
                                 700 * uniform(random));
    const Eigen::Vector3d way =
        Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
    const double pace = 80.0 + 50.0 * uniform(random), phase = uniform(random);
    const Eigen::Vector3d drift(40 * std::sin(stage / 50.0 + k), 40 * std::cos(stage / 60.0 + k),
                                0);
    const Eigen::Vector3d off =
        60.0 * std::sin(2 * std::numbers::pi * (stage / pace + phase)) * way;
    points.push_back(centre + drift + off);
    points.push_back(centre + drift - off);
  }
  return points;
}

TEST(Tracker, CrossingPointsAreNeverSwapped) {
  for (const unsigned seed : {1u, 2u}) {
    TrackedRun run(seed);
    for (int s = 0; s < 1000; ++s) run.Add(Pairs(100, s, seed), {}, 0.1);
    EXPECT_EQ(run.Swapped(), 0) << "seed " << seed;
  }
}

TEST(Tracker, DecidingAtOnceSwapsWhereDeferringDoesNot) {
  // That the window is what keeps identities: without it some are swapped.
  LinkOptions at_once;
  at_once.window_stages = 0;
  int swapped = 0;
  for (const unsigned seed : {1u, 2u, 3u}) {
    TrackedRun run(seed, at_once);
    for (int s = 0; s < 1000; ++s) run.Add(Pairs(100, s, seed), {}, 0.1);
    swapped += run.Swapped();
  }
  EXPECT_GT(swapped, 0);
}

TEST(Tracker, GapsOfOneToTwentyStages) {
  for (int gap = 1; gap <= 20; ++gap) {
    TrackedRun run(static_cast<unsigned>(gap));
    for (int s = 0; s < 60; ++s) {
      auto points = Pairs(10, s, 3);
      if (s >= 30 && s < 30 + gap) points[0].setConstant(std::numeric_limits<double>::quiet_NaN());
      run.Add(points);
    }
    EXPECT_EQ(run.NumbersOf(0).size(), 1u) << "gap " << gap;
  }
}

TEST(Tracker, AllLeaveAndComeBack) {
  TrackedRun run(4);
  const std::vector<Eigen::Vector3d> none;
  run.Add(none);  // the first stage is empty
  for (int s = 0; s < 30; ++s) {
    if (s >= 20 && s < 23) {
      run.Add(none);
    } else {
      run.Add(Pairs(10, s, 5));
    }
  }
  for (int p = 0; p < 20; ++p) EXPECT_EQ(run.NumbersOf(p).size(), 1u) << p;
}

TEST(Tracker, PointsEnterAndLeave) {
  TrackedRun run(5);
  std::vector<Eigen::Vector3d> points;
  for (int s = 0; s < 120; ++s) {
    points.assign(60, Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
    for (int p = 0; p < 60; ++p) {  // each goes by within 30 stages
      const int age = s - 2 * p;
      if (age >= 0 && age < 30)
        points[static_cast<std::size_t>(p)] = {10.0 * age, 70.0 * (p % 7), 90.0 * (p % 5)};
    }
    run.Add(points);
  }
  std::set<int> all;
  for (int p = 0; p < 60; ++p) {
    const auto numbers = run.NumbersOf(p);
    EXPECT_EQ(numbers.size(), 1u) << p;
    all.insert(numbers.begin(), numbers.end());
  }
  EXPECT_EQ(all.size(), 60u);
}

TEST(Tracker, FewPoints) {
  for (const int n : {1, 2}) {
    TrackedRun run(6);
    for (int s = 0; s < 30; ++s) {
      std::vector<Eigen::Vector3d> points;
      for (int p = 0; p < n; ++p) points.emplace_back(3.0 * s + 0.1 * s * s, 200.0 * p, 0.0);
      run.Add(points);
    }
    for (int p = 0; p < n; ++p) EXPECT_EQ(run.NumbersOf(p).size(), 1u) << n;
  }
}

TEST(Tracker, ALateCodeNamesThePointBefore) {
  TrackedRun run(7);
  for (int s = 0; s < 40; ++s) {
    std::vector<int> codes(20, -1);
    codes[3] = s < 25 ? -1 : 77;
    codes[4] = s < 5 || s > 9 ? 78 : -1;
    run.Add(Pairs(10, s, 8), codes, s < 2 ? 0.0 : 0.05);
  }
  EXPECT_EQ(run.NumbersOf(4), std::set<int>{78});
  EXPECT_EQ(run.NumbersOf(3), std::set<int>{77});
}

TEST(Tracker, ACodeAtTwoPlacesIsNotRead) {
  TrackedRun run(9);
  for (int s = 0; s < 10; ++s) {
    std::vector<int> codes(20, -1);
    codes[0] = 7;
    codes[9] = s == 5 ? 7 : 8;
    run.Add(Pairs(10, s, 11), codes);
  }
  EXPECT_EQ(run.NumbersOf(0), std::set<int>{7});
  EXPECT_EQ(run.NumbersOf(9), std::set<int>{8});
}

TEST(Tracker, LogOddsTellWhatIsUnsure) {
  LinkOptions at_once;
  at_once.window_stages = 0;
  TrackedRun run(10, at_once);
  for (int s = 0; s <= 20; ++s) {  // two points meet at stage 20, a third goes alone
    run.Add({{1.0 * s - 20.0, 0, 0}, {20.0 - 1.0 * s, 0, 0}, {1.0 * s, 300, 0}});
  }
  for (std::size_t r = 0; r < 3; ++r) {
    const bool meets = run.who.back()[r] < 2;
    EXPECT_EQ(run.log_odds.back()[r] < 4.6, meets) << run.log_odds.back()[r];
  }
  for (const double odds : run.log_odds.front()) EXPECT_TRUE(std::isnan(odds));
}

TEST(Tracker, IsDeterministicAndBounded) {
  TrackedRun a(11), b(11);
  for (int s = 0; s < 200; ++s) {
    a.Add(Pairs(30, s, 12), {}, 0.2);
    b.Add(Pairs(30, s, 12), {}, 0.2);
  }
  EXPECT_EQ(a.numbers, b.numbers);
  EXPECT_LE(a.tracker.num_points(), 90u);
}

TEST(Tracker, RefusesWhatIsNoPoint) {
  Tracker tracker(kFree);
  const std::vector<Eigen::Matrix3d> cov{Eigen::Matrix3d::Identity()};
  const std::vector<Eigen::Vector3d> zero{Eigen::Vector3d::Zero()};
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(tracker.Add(std::vector<int>{-1}, std::vector<Eigen::Vector3d>{{0, nan, 0}}, cov),
               std::invalid_argument);
  EXPECT_THROW(tracker.Add(std::vector<int>{-1}, zero, std::vector<Eigen::Matrix3d>{nan * cov[0]}),
               std::invalid_argument);
  EXPECT_THROW(tracker.Add(std::vector<int>{-1}, zero, std::vector<Eigen::Matrix3d>{0 * cov[0]}),
               std::invalid_argument);
  EXPECT_THROW(tracker.Add(std::vector<int>{kFree}, zero, cov), std::invalid_argument);
  EXPECT_THROW(tracker.Add(std::vector<int>{1, 2}, zero, cov), std::invalid_argument);
  EXPECT_EQ(tracker.num_points(), 0u);
  EXPECT_THROW(Tracker(kFree, {.gate_sigma = 0}), std::invalid_argument);
  EXPECT_THROW(Tracker(kFree, {.max_share_of_spacing = 0.5}), std::invalid_argument);
  EXPECT_THROW(Tracker(kFree, {.window_stages = 16}), std::invalid_argument);
  EXPECT_THROW(Tracker(-1), std::invalid_argument);
}

}  // namespace
}  // namespace videogrammetry
