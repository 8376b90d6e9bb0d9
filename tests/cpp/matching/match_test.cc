#include "videogrammetry/matching/match.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "matching/scene.h"

namespace videogrammetry {
namespace {

constexpr double kSigmaPx = 0.05;

Rig ArcRig(int n) {
  Rig rig;
  for (int i = 0; i < n; ++i) {
    Camera camera{1280, 1024, {}, 500.0, DistortionDirection::kMeasured};
    camera.interior << 2650, 20, -15, -2e-8, 0, 0, 6e-8, -7e-7, 0, 0;
    // Off the plane of the arc by turns, so that epipolar lines cross.
    const Eigen::Matrix3d rotation =
        RotationFromVector({0.1 * (i % 2), (i - 0.5 * (n - 1)) * 0.4, 0});
    const Eigen::Vector3d target(0, 0, 12000);
    rig.push_back({camera, Rigid3{rotation, target - rotation * target}});
  }
  return rig;
}

// Noisy pictures in random order; `coded` gives the first points an ID.
Scene Picture(const Rig& rig, const std::vector<Eigen::Vector3d>& points, int coded,
              std::mt19937* random) {
  return Picture(rig, points, {.sigma_px = kSigmaPx, .radius_mm = 20.0, .coded = coded}, random);
}

std::vector<Eigen::Vector3d> Cloud(int n, std::mt19937* random, double depth = 12000) {
  std::uniform_real_distribution<double> across(-1500, 1500);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < n; ++i) {
    points.emplace_back(across(*random), across(*random), depth + across(*random));
  }
  return points;
}

// A slightly bent grid, as panels are: the rows lie nearly on epipolar lines.
std::vector<Eigen::Vector3d> Panel(std::mt19937* random) {
  std::normal_distribution<double> jitter(0, 2.0);
  std::vector<Eigen::Vector3d> points;
  for (int j = 0; j < 12; ++j) {
    for (int i = 0; i < 18; ++i) {
      const double x = 130.0 * i - 1105, y = 130.0 * j - 715;
      points.emplace_back(x + jitter(*random), y + jitter(*random), 12000 + 0.2 * x + 1e-5 * x * x);
    }
  }
  std::shuffle(points.begin(), points.end(), *random);
  return points;
}

TEST(Matching, FindsTheCloudInThreeToFiveCameras) {
  for (const int n : {3, 4, 5}) {
    for (const unsigned seed : {1U, 2U}) {
      std::mt19937 random(seed);
      const Rig rig = ArcRig(n);
      const Scene scene = Picture(rig, Cloud(100, &random), 0, &random);
      const Count count = Judge(scene, MatchStage(rig, scene.cameras));
      // Chance partners: 100 targets x gate 0.55 px x 1280 px / 1.3 Mpx = 0.05 a
      // target and pair, and a third camera confirms one in a thousand.
      EXPECT_EQ(count.wrong, 0) << n << " cameras, seed " << seed;
      EXPECT_GE(count.right, 98) << n << " cameras, seed " << seed;
    }
  }
}

TEST(Matching, TwoCamerasOnADensePanelThroughCodedNeighbours) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    std::mt19937 random(seed);
    const Rig rig = ArcRig(2);
    const Scene scene = Picture(rig, Panel(&random), 60, &random);
    const Count count = Judge(scene, MatchStage(rig, scene.cameras));
    EXPECT_EQ(count.wrong, 0) << "seed " << seed;
    EXPECT_GE(count.right, 210) << "seed " << seed;  // of 216
  }
}

TEST(Matching, NamesAmbiguousTargetsInsteadOfGuessing) {
  // Two points whose pictures lie on one epipolar line in both cameras: two
  // pairings fit equally.
  const Rig rig = ArcRig(2);
  const Eigen::Vector3d a = rig[0].center_in_world(), b = rig[1].center_in_world();
  const Eigen::Vector3d p(0, 0, 12000);
  const Eigen::Vector3d in_plane = (b - a).normalized();
  const std::vector<Eigen::Vector3d> points = {p, p + 400 * in_plane};
  std::mt19937 random(4);
  const Scene scene = Picture(rig, points, 0, &random);
  const MatchResult result = MatchStage(rig, scene.cameras);
  EXPECT_TRUE(result.matches.empty());
  for (const auto& status : result.status) {
    for (const TargetMatch s : status) EXPECT_EQ(s, TargetMatch::kAmbiguous);
  }
}

TEST(Matching, AWrongIdIsFoundByItsRays) {
  std::mt19937 random(5);
  const Rig rig = ArcRig(4);
  Scene scene = Picture(rig, Cloud(20, &random), 20, &random);
  // Camera 2 reads two IDs the wrong way round.
  auto& ids = scene.cameras[2].id;
  const auto first = std::find(ids.begin(), ids.end(), 3) - ids.begin();
  const auto second = std::find(ids.begin(), ids.end(), 7) - ids.begin();
  std::swap(ids[static_cast<std::size_t>(first)], ids[static_cast<std::size_t>(second)]);
  const MatchResult result = MatchStage(rig, scene.cameras);
  EXPECT_EQ(result.matches.size(), 20U);
  EXPECT_EQ(result.status[2][static_cast<std::size_t>(first)], TargetMatch::kInconsistentId);
  EXPECT_EQ(result.status[2][static_cast<std::size_t>(second)], TargetMatch::kInconsistentId);
  EXPECT_EQ(Judge(scene, result).wrong, 0);
}

TEST(Matching, AnUnreadRingIsMatchedToItsCodedPartner) {
  std::mt19937 random(6);
  const Rig rig = ArcRig(3);
  Scene scene = Picture(rig, Cloud(30, &random), 30, &random);
  for (int& id : scene.cameras[1].id) id = -1;
  for (int& id : scene.cameras[2].id) id = -1;
  const MatchResult result = MatchStage(rig, scene.cameras);
  EXPECT_EQ(Judge(scene, result).wrong, 0);
  ASSERT_GE(result.matches.size(), 29U);
  for (const Match& match : result.matches) {
    ASSERT_GE(match.target[0], 0);
    EXPECT_EQ(match.id, scene.truth[0][static_cast<std::size_t>(match.target[0])] + 1);
  }
}

// Rays of the matched targets meet: chi2 below the limit of the gate's level.
TEST(Matching, NeverInconsistentRaysNorATargetTwice) {
  std::mt19937 random(8);
  const Rig rig = ArcRig(4);
  const Scene scene = Picture(rig, Cloud(400, &random), 0, &random);
  const MatchResult result = MatchStage(rig, scene.cameras);
  ASSERT_GE(result.matches.size(), 380U);
  std::vector<std::vector<int>> used;
  for (const CameraTargets& c : scene.cameras) used.emplace_back(c.size(), 0);
  for (const Match& match : result.matches) {
    std::vector<Sighting> sightings;
    for (std::size_t c = 0; c < rig.size(); ++c) {
      if (match.target[c] < 0) continue;
      const auto t = static_cast<std::size_t>(match.target[c]);
      EXPECT_EQ(used[c][t]++, 0);
      sightings.push_back(
          {static_cast<int>(c), scene.cameras[c].xy_px[t], scene.cameras[c].cov_px2[t]});
    }
    Intersection point;
    ASSERT_EQ(Intersect(rig, sightings, &point), IntersectionStatus::kOk);
    // Level 1e-4: 25.7 for five degrees of freedom; 15.1 and 21.1 for one and three.
    const double limit[] = {0, 0, 15.2, 21.3, 26.0};
    EXPECT_LT(point.chi2, limit[sightings.size()]);
    // The normalised picture's chi2 is the pixels' to second order in 0.05 / 2650.
    EXPECT_NEAR(match.chi2, point.chi2, 1e-3 * (1 + point.chi2));
  }
}

TEST(Matching, TheOrderOfTheCamerasDoesNotMatter) {
  std::mt19937 random(9);
  const Rig rig = ArcRig(4);
  const Scene scene = Picture(rig, Cloud(300, &random), 0, &random);
  const MatchResult straight = MatchStage(rig, scene.cameras);
  const std::vector<std::size_t> order = {2, 0, 3, 1};
  Rig other;
  std::vector<CameraTargets> pictures;
  for (const std::size_t c : order) {
    other.push_back(rig[c]);
    pictures.push_back(scene.cameras[c]);
  }
  std::vector<std::vector<int>> a, b;
  for (const Match& match : straight.matches) a.push_back(match.target);
  for (const Match& match : MatchStage(other, pictures).matches) {
    std::vector<int> back(4);
    for (std::size_t k = 0; k < 4; ++k) back[order[k]] = match.target[k];
    b.push_back(back);
  }
  std::sort(a.begin(), a.end());
  std::sort(b.begin(), b.end());
  EXPECT_EQ(a, b);
}

TEST(Matching, UpToSixtyFourCameras) {
  for (const int n : {2, 8, 16, 64}) {
    std::mt19937 random(10);
    Rig rig;
    for (int i = 0; i < n; ++i) {
      const double angle = n == 2 ? 0.8 * i : 6.2832 * i / n;
      Camera camera{1280, 1024, {}, 500.0, DistortionDirection::kMeasured};
      camera.interior << 2650, 20, -15, -2e-8, 0, 0, 6e-8, -7e-7, 0, 0;
      rig.push_back(
          {camera, Rigid3{RotationFromVector({0.1 * (i % 3), angle + 0.2, 0}), {0, 0, 12000}}});
    }
    const Scene scene = Picture(rig, Cloud(30, &random, 0), 0, &random);
    const MatchResult result = MatchStage(rig, scene.cameras);
    const Count count = Judge(scene, result);
    EXPECT_EQ(count.wrong, 0) << n;
    EXPECT_GE(count.right, 28) << n;
    if (n < 3) continue;
    for (const Match& match : result.matches) {
      // Each camera's gate keeps 1 - 1e-4 of its targets.
      EXPECT_GE(
          std::count_if(match.target.begin(), match.target.end(), [](int t) { return t >= 0; }),
          n - 1);
    }
  }
  Rig many(65, ArcRig(2)[0]);
  EXPECT_THROW(MatchStage(many, std::vector<CameraTargets>(65)), std::invalid_argument);
}

// Two pairs on opposite sides of an object: no point is seen by both.
TEST(Matching, GroupsWithoutACommonView) {
  std::mt19937 random(12);
  Rig rig;
  for (const double angle : {-0.2, 0.2, 2.94, 3.34}) {
    Camera camera{1280, 1024, {}, 500.0, DistortionDirection::kMeasured};
    camera.interior << 2650, 20, -15, 0, 0, 0, 0, 0, 0, 0;
    const double up = angle == 0.2 || angle == 3.34 ? 0.1 : 0.0;
    rig.push_back(
        {camera, Rigid3{RotationFromVector({up, 0, 0}) * RotationFromVector({0, angle, 0}),
                        {0, 0, 12000}}});
  }
  std::vector<Eigen::Vector3d> front = Cloud(30, &random, 0), back = Cloud(30, &random, 0);
  std::vector<Eigen::Vector3d> points = front;
  points.insert(points.end(), back.begin(), back.end());
  Scene scene = Picture(rig, points, 0, &random);
  for (std::size_t c = 0; c < 4; ++c) {
    CameraTargets kept;
    std::vector<int> truth;
    for (std::size_t t = 0; t < scene.cameras[c].size(); ++t) {
      if ((scene.truth[c][t] < 30) != (c < 2)) continue;
      kept.xy_px.push_back(scene.cameras[c].xy_px[t]);
      kept.cov_px2.push_back(scene.cameras[c].cov_px2[t]);
      kept.id.push_back(-1);
      kept.semi_major_px.push_back(scene.cameras[c].semi_major_px[t]);
      truth.push_back(scene.truth[c][t]);
    }
    scene.cameras[c] = kept;
    scene.truth[c] = truth;
  }
  const Count count = Judge(scene, MatchStage(rig, scene.cameras));
  EXPECT_EQ(count.wrong, 0);
  // Two cameras: a chance partner in the gate leaves a few in doubt.
  EXPECT_GE(count.right, 50);
}

// Two cameras, a dense cloud, missing pictures and clutter: of the matches stated with a
// probability p of being false, p are. With n matches of a bin the share scatters by
// sqrt(p (1 - p) / n); 5 of those, and 2 % for what the statistics' estimates leave.
TEST(Matching, TheProbabilityIsTheShareOfFalseMatches) {
  MatchingOptions options;
  options.min_log_odds = 0;
  options.neighbours = 0;
  constexpr int kBins = 5;
  double stated[kBins] = {}, wrong[kBins] = {}, number[kBins] = {};
  const Rig rig = ArcRig(2);
  for (unsigned seed = 0; seed < 15; ++seed) {
    std::mt19937 random(100 + seed);
    Scene scene = Picture(rig, Cloud(400, &random), 0, &random);
    std::uniform_real_distribution<double> one(0, 1);
    for (std::size_t c = 0; c < 2; ++c) {
      for (std::size_t t = 0; t < scene.cameras[c].size(); ++t) {
        if (one(random) > 0.1) continue;  // another thing instead of the point
        scene.cameras[c].xy_px[t] = {1279 * one(random), 1023 * one(random)};
        scene.truth[c][t] = -static_cast<int>(1000 * c + t) - 1;
      }
    }
    for (const Match& match : MatchStage(rig, scene.cameras, options).matches) {
      const auto bin =
          static_cast<std::size_t>(std::min(kBins - 1.0, kBins * 2 * match.false_probability));
      const int a = scene.truth[0][static_cast<std::size_t>(match.target[0])];
      const int b = scene.truth[1][static_cast<std::size_t>(match.target[1])];
      stated[bin] += match.false_probability;
      wrong[bin] += a != b;
      ++number[bin];
    }
  }
  for (int k = 0; k < kBins; ++k) {
    ASSERT_GT(number[k], 30) << k;
    const double p = stated[k] / number[k];
    EXPECT_NEAR(wrong[k] / number[k], p, 5 * std::sqrt(p * (1 - p) / number[k]) + 0.02) << k;
  }
}

// Points and clutter in a part of the pictures only: lone targets are as dense as they are
// there, not over all of the picture.
TEST(Matching, TheProbabilityWhereACommonVolumeFillsAPart) {
  MatchingOptions options;
  options.min_log_odds = 0;
  options.neighbours = 0;
  const Rig rig = ArcRig(2);
  double stated = 0, wrong = 0, number = 0;
  for (unsigned seed = 0; seed < 15; ++seed) {
    std::mt19937 random(300 + seed);
    std::vector<Eigen::Vector3d> points = Cloud(400, &random);
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : points) mean += p / 400.0;
    for (Eigen::Vector3d& p : points) p = mean + 0.4 * (p - mean);
    Scene scene = Picture(rig, points, 0, &random);
    std::uniform_real_distribution<double> one(0, 1);
    for (std::size_t c = 0; c < 2; ++c) {
      Eigen::Vector2d low = scene.cameras[c].xy_px[0], high = low;
      for (const Eigen::Vector2d& xy : scene.cameras[c].xy_px) {
        low = low.cwiseMin(xy);
        high = high.cwiseMax(xy);
      }
      for (std::size_t t = 0; t < scene.cameras[c].size(); ++t) {
        if (one(random) > 0.1) continue;
        const Eigen::Vector2d share(one(random), one(random));
        scene.cameras[c].xy_px[t] = low + (high - low).cwiseProduct(share);
        scene.truth[c][t] = -static_cast<int>(1000 * c + t) - 1;
      }
    }
    for (const Match& match : MatchStage(rig, scene.cameras, options).matches) {
      stated += match.false_probability;
      wrong += scene.truth[0][static_cast<std::size_t>(match.target[0])] !=
               scene.truth[1][static_cast<std::size_t>(match.target[1])];
      ++number;
    }
  }
  ASSERT_GT(number, 1000);
  // Of the number of wrong ones the standard deviation is its root at most; a quarter more
  // for what the model leaves out (the volume is no box).
  EXPECT_NEAR(wrong, stated, 4 * std::sqrt(stated) + 0.25 * stated);
}

TEST(Matching, ThreadsDoNotChangeTheResult) {
  std::mt19937 random(77);
  const Rig rig = ArcRig(4);
  const Scene scene = Picture(rig, Cloud(400, &random), 0, &random);
  MatchingOptions options;
  const MatchResult one = MatchStage(rig, scene.cameras, options);
  options.num_threads = 3;
  const MatchResult three = MatchStage(rig, scene.cameras, options);
  ASSERT_EQ(one.matches.size(), three.matches.size());
  for (std::size_t k = 0; k < one.matches.size(); ++k) {
    EXPECT_EQ(one.matches[k].target, three.matches[k].target);
    EXPECT_EQ(one.matches[k].log_odds, three.matches[k].log_odds);
  }
  options.num_threads = -1;
  EXPECT_THROW(MatchStage(rig, scene.cameras, options), std::invalid_argument);
}

TEST(Matching, EditsComeFirst) {
  std::mt19937 random(13);
  const Rig rig = ArcRig(3);
  const Scene scene = Picture(rig, Cloud(20, &random), 0, &random);
  const MatchResult plain = MatchStage(rig, scene.cameras);
  ASSERT_GE(plain.matches.size(), 19U);
  const std::vector<int> own = plain.matches[0].target;
  MatchEdits edits;
  edits.apart = {{{0, own[0]}, {1, own[1]}}};
  for (const Match& match : MatchStage(rig, scene.cameras, {}, edits).matches) {
    EXPECT_FALSE(match.target[0] == own[0] && match.target[1] == own[1]);
  }
  // Two targets of different points, whose rays miss each other.
  const int stranger = plain.matches[1].target[1];
  edits = {};
  edits.together = {{{0, own[0]}, {1, stranger}}};
  const MatchResult forced = MatchStage(rig, scene.cameras, {}, edits);
  EXPECT_EQ(forced.matches[0].target[0], own[0]);
  EXPECT_EQ(forced.matches[0].target[1], stranger);
  EXPECT_EQ(forced.matches[0].false_probability, 0.0);
  edits.together = {{{0, own[0]}, {0, 1}}};
  EXPECT_THROW(MatchStage(rig, scene.cameras, {}, edits), std::invalid_argument);
  edits.together = {{{0, 99}, {1, 1}}};
  EXPECT_THROW(MatchStage(rig, scene.cameras, {}, edits), std::invalid_argument);
  edits.together = {{{0, 1}}};
  EXPECT_THROW(MatchStage(rig, scene.cameras, {}, edits), std::invalid_argument);
}

TEST(Matching, EmptyPicturesAndBadArguments) {
  const Rig rig = ArcRig(2);
  std::vector<CameraTargets> cameras(2);
  EXPECT_TRUE(MatchStage(rig, cameras).matches.empty());
  EXPECT_THROW(MatchStage(rig, std::span(cameras).first(1)), std::invalid_argument);
  MatchingOptions options;
  options.critical_value = 0;
  EXPECT_THROW(MatchStage(rig, cameras, options), std::invalid_argument);
  cameras[0].xy_px.emplace_back(1, 1);
  EXPECT_THROW(MatchStage(rig, cameras), std::invalid_argument);
}

}  // namespace
}  // namespace videogrammetry
