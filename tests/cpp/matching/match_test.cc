#include "videogrammetry/matching/match.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>
#include <stdexcept>

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

struct Scene {
  std::vector<CameraTargets> cameras;
  std::vector<std::vector<int>> truth;  // camera, target -> point
};

// Noisy pictures in random order; `coded` gives the first points an ID.
Scene Picture(const Rig& rig, const std::vector<Eigen::Vector3d>& points, int coded,
              std::mt19937* random) {
  std::normal_distribution<double> noise(0, kSigmaPx);
  Scene scene;
  for (const OrientedCamera& oriented : rig) {
    std::vector<int> order(points.size());
    std::iota(order.begin(), order.end(), 0);
    std::shuffle(order.begin(), order.end(), *random);
    CameraTargets targets;
    std::vector<int> truth;
    for (const int p : order) {
      const Eigen::Vector3d& point = points[static_cast<std::size_t>(p)];
      const Eigen::Vector2d pixel = *ProjectFromWorld(oriented, point);
      targets.xy_px.push_back(pixel + Eigen::Vector2d(noise(*random), noise(*random)));
      targets.cov_px2.push_back(kSigmaPx * kSigmaPx * Eigen::Matrix2d::Identity());
      targets.id.push_back(p < coded ? p + 1 : -1);
      targets.semi_major_px.push_back(20.0 * oriented.camera.f_px() /
                                      (oriented.cam_from_world * point).z());
      truth.push_back(p);
    }
    scene.cameras.push_back(std::move(targets));
    scene.truth.push_back(std::move(truth));
  }
  return scene;
}

struct Count {
  int right = 0, wrong = 0;
};

Count Judge(const Scene& scene, const MatchResult& result) {
  Count count;
  for (const Match& match : result.matches) {
    int point = -1;
    bool same = true;
    for (std::size_t c = 0; c < match.target.size(); ++c) {
      if (match.target[c] < 0) continue;
      const int p = scene.truth[c][static_cast<std::size_t>(match.target[c])];
      same = same && (point < 0 || p == point);
      point = p;
    }
    ++(same ? count.right : count.wrong);
  }
  return count;
}

std::vector<Eigen::Vector3d> Cloud(int n, std::mt19937* random) {
  std::uniform_real_distribution<double> across(-1500, 1500);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < n; ++i) {
    points.emplace_back(across(*random), across(*random), 12000 + across(*random));
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
