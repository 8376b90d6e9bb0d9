#include "videogrammetry/matching/stages.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <random>

namespace videogrammetry {
namespace {

constexpr double kSigmaPx = 0.05;

Rig Around(int cameras) {
  Rig rig;
  for (int i = 0; i < cameras; ++i) {
    Camera camera{1280, 1024, {}, 500.0, DistortionDirection::kMeasured};
    camera.interior << 2500, 5, -4, -2e-8, 0, 0, 6e-8, -7e-7, 0, 0;
    const double angle = 2 * 3.14159265 * (i + 0.3) / cameras;
    rig.push_back(
        {camera, Rigid3{RotationFromVector({0.25 * std::sin(angle), 0.35 * std::cos(angle), 0}),
                        {0, 0, 1000}}});
  }
  return rig;
}

struct Sequence {
  std::vector<FlatTargets> cameras;
  std::vector<std::vector<int>> truth;  // a camera, its targets: the point or -1
};

// Points on circles; each camera misses one in `miss` and has `clutter` targets of none.
Sequence Film(const Rig& rig, int points, int stages, int coded, double miss, int clutter,
              unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> one(0, 1);
  std::normal_distribution<double> noise(0, kSigmaPx);
  std::vector<Eigen::Vector3d> place;
  std::vector<double> phase;
  for (int p = 0; p < points; ++p) {
    place.emplace_back(250 * one(random) - 125, 200 * one(random) - 100, 200 * one(random) - 100);
    phase.push_back(6.28 * one(random));
  }
  Sequence film;
  film.cameras.resize(rig.size());
  film.truth.resize(rig.size());
  for (FlatTargets& c : film.cameras) c.offsets.push_back(0);
  for (int s = 0; s < stages; ++s) {
    for (std::size_t c = 0; c < rig.size(); ++c) {
      CameraTargets& t = film.cameras[c].targets;
      std::vector<int> order(static_cast<std::size_t>(points + clutter));
      std::iota(order.begin(), order.end(), 0);
      std::shuffle(order.begin(), order.end(), random);
      for (const int p : order) {
        Eigen::Vector2d pixel(1279 * one(random), 1023 * one(random));
        if (p < points) {
          if (one(random) < miss) continue;
          const auto k = static_cast<std::size_t>(p);
          const double angle = phase[k] + 0.05 * s;
          pixel = *ProjectFromWorld(
              rig[c], place[k] + 20 * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0));
        }
        t.xy_px.push_back(pixel + Eigen::Vector2d(noise(random), noise(random)));
        t.cov_px2.push_back(kSigmaPx * kSigmaPx * Eigen::Matrix2d::Identity());
        t.id.push_back(p < coded ? p + 1 : -1);
        t.semi_major_px.push_back(0);
        film.truth[c].push_back(p < points ? p : -1);
      }
      film.cameras[c].offsets.push_back(t.size());
    }
  }
  return film;
}

struct Count {
  int right = 0, wrong = 0, twice = 0;
};

Count Judge(const Sequence& film, const StageMatches& result) {
  Count count;
  const std::size_t cameras = film.cameras.size();
  std::vector<std::vector<int>> used;
  for (const FlatTargets& c : film.cameras) used.emplace_back(c.targets.size(), 0);
  for (std::size_t s = 0; s + 1 < result.offsets.size(); ++s) {
    for (std::size_t k = result.offsets[s]; k < result.offsets[s + 1]; ++k) {
      int own = -2;
      bool same = true;
      for (std::size_t c = 0; c < cameras; ++c) {
        const int t = result.target[k * cameras + c];
        if (t < 0) continue;
        const std::size_t m = film.cameras[c].offsets[s] + static_cast<std::size_t>(t);
        count.twice += used[c][m]++;
        const int p = film.truth[c][m];
        same = same && p >= 0 && (own == -2 || own == p);
        own = p;
      }
      ++(same ? count.right : count.wrong);
    }
  }
  return count;
}

// Each point is in two or more of n cameras at 1 - m^n - n m^(n-1) (1-m) of the stages.
TEST(MatchStages, FollowsPointsThroughGapsAndClutter) {
  for (const int cameras : {3, 4}) {
    const Rig rig = Around(cameras);
    const Sequence film = Film(rig, 40, 30, 0, 0.05, 5, 7);
    const StageMatches result = MatchStages(rig, film.cameras);
    const Count count = Judge(film, result);
    const double seen = cameras == 3 ? 0.993 : 0.9995;
    EXPECT_GE(count.right, 0.98 * seen * 40 * 30) << cameras << " cameras";
    // 10^-2 is the largest stated probability of a false match; most are far surer.
    EXPECT_LE(count.wrong, 0.002 * 40 * 30) << cameras << " cameras";
    EXPECT_EQ(count.twice, 0);
  }
}

TEST(MatchStages, EqualToItselfAndToTheSingleStageOnOne) {
  const Rig rig = Around(4);
  const Sequence film = Film(rig, 60, 1, 20, 0.02, 3, 3);
  const StageMatches once = MatchStages(rig, film.cameras);
  const StageMatches again = MatchStages(rig, film.cameras);
  EXPECT_EQ(once.target, again.target);
  EXPECT_EQ(once.log_odds, again.log_odds);
  std::vector<CameraTargets> stage;
  for (const FlatTargets& c : film.cameras) stage.push_back(c.targets);
  EXPECT_EQ(once.id.size(), MatchStage(rig, stage).matches.size());
}

TEST(MatchStages, TwoCamerasGainByTheSequence) {
  // 150 points: at one stage a camera's epipolar line passes 1500 px x 0.4 px x 150 /
  // 1.3 Mpx = 0.07 others within the gate, so that every tenth pair is in doubt.
  const Rig rig = Around(2);
  const Sequence film = Film(rig, 150, 12, 0, 0.0, 0, 11);
  const Count all = Judge(film, MatchStages(rig, film.cameras));
  int single = 0;
  for (std::size_t s = 0; s < 12; ++s) {
    std::vector<CameraTargets> stage(2);
    for (std::size_t c = 0; c < 2; ++c) {
      const FlatTargets& f = film.cameras[c];
      for (std::size_t m = f.offsets[s]; m < f.offsets[s + 1]; ++m) {
        stage[c].xy_px.push_back(f.targets.xy_px[m]);
        stage[c].cov_px2.push_back(f.targets.cov_px2[m]);
        stage[c].id.push_back(-1);
        stage[c].semi_major_px.push_back(0);
      }
    }
    single += static_cast<int>(MatchStage(rig, stage).matches.size());
  }
  EXPECT_GT(all.right, single);
  EXPECT_LE(all.wrong, 0.02 * 150 * 12);
}

TEST(MatchStages, CodesAreKeptWhereTheRingIsNotRead) {
  const Rig rig = Around(3);
  Sequence film = Film(rig, 20, 10, 20, 0.0, 0, 5);
  const std::size_t first = film.cameras[1].offsets[6], last = film.cameras[1].offsets[7];
  for (FlatTargets& c : film.cameras) {
    for (std::size_t m = c.offsets[6]; m < c.offsets[7]; ++m) c.targets.id[m] = -1;
  }
  const StageMatches result = MatchStages(rig, film.cameras);
  ASSERT_EQ(result.offsets[7] - result.offsets[6], 20U);
  ASSERT_EQ(last - first, 20U);
  for (std::size_t k = result.offsets[6]; k < result.offsets[7]; ++k) {
    const std::size_t m = first + static_cast<std::size_t>(result.target[3 * k + 1]);
    EXPECT_EQ(result.id[k], film.truth[1][m] + 1);
  }
}

TEST(MatchStages, EditsAreRespected) {
  const Rig rig = Around(3);
  const Sequence film = Film(rig, 10, 5, 0, 0.0, 0, 9);
  std::vector<ViewTarget> own;  // of point 0 at stage 2
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t m = film.cameras[c].offsets[2]; m < film.cameras[c].offsets[3]; ++m) {
      if (film.truth[c][m] == 0) {
        own.push_back({static_cast<int>(c), static_cast<int>(m - film.cameras[c].offsets[2])});
      }
    }
  }
  ASSERT_EQ(own.size(), 3U);
  std::map<std::size_t, MatchEdits> edits;
  edits[2].apart = {{own[0], own[1]}};
  const StageMatches result = MatchStages(rig, film.cameras, {}, edits);
  for (std::size_t k = result.offsets[2]; k < result.offsets[3]; ++k) {
    EXPECT_FALSE(result.target[3 * k] == own[0].target &&
                 result.target[3 * k + 1] == own[1].target);
  }
  edits[2] = {};
  edits[2].together = {own};
  const StageMatches joined = MatchStages(rig, film.cameras, {}, edits);
  int found = 0;
  for (std::size_t k = joined.offsets[2]; k < joined.offsets[3]; ++k) {
    if (joined.target[3 * k] != own[0].target) continue;
    EXPECT_EQ(joined.target[3 * k + 1], own[1].target);
    EXPECT_EQ(joined.target[3 * k + 2], own[2].target);
    EXPECT_EQ(joined.false_probability[k], 0.0);
    ++found;
  }
  EXPECT_EQ(found, 1);
}

TEST(MatchStages, BadArguments) {
  const Rig rig = Around(2);
  Sequence film = Film(rig, 3, 2, 0, 0, 0, 1);
  EXPECT_THROW(MatchStages(rig, {film.cameras[0]}), std::invalid_argument);
  std::map<std::size_t, MatchEdits> late;
  late[2].together = {};
  EXPECT_THROW(MatchStages(rig, film.cameras, {}, late), std::invalid_argument);
  film.cameras[0].offsets.back() += 1;
  EXPECT_THROW(MatchStages(rig, film.cameras), std::invalid_argument);
}

}  // namespace
}  // namespace videogrammetry
