#include "videogrammetry/geometry/intersection.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <random>

namespace videogrammetry {
namespace {

// n cameras on an arc around (0, 0, 12 m), 25 degrees apart.
Rig ArcRig(int n) {
  Rig rig;
  for (int i = 0; i < n; ++i) {
    Camera camera{1024, 1024, {}, 400.0, DistortionDirection::kMeasured};
    camera.interior << 2650, -50, -40, -2e-8, 0, 0, 6e-8, -7e-7, 0, 0;
    const Eigen::Matrix3d rotation = RotationFromVector({0, (i - 0.5 * (n - 1)) * 0.436, 0});
    const Eigen::Vector3d target(0, 0, 12000);
    rig.push_back({camera, Rigid3{rotation, target - rotation * target}});
  }
  return rig;
}

std::vector<Sighting> Sight(const Rig& rig, const Eigen::Vector3d& point, double sigma,
                            std::mt19937* random) {
  std::normal_distribution<double> noise(0, sigma);
  std::vector<Sighting> sightings;
  for (std::size_t c = 0; c < rig.size(); ++c) {
    const Eigen::Vector2d pixel = *ProjectFromWorld(rig[c], point);
    sightings.push_back({static_cast<int>(c),
                         pixel + Eigen::Vector2d(noise(*random), noise(*random)),
                         sigma * sigma * Eigen::Matrix2d::Identity()});
  }
  return sightings;
}

TEST(Intersection, ExactPicturesGiveThePoint) {
  std::mt19937 random(1);
  for (const int n : {2, 3, 5}) {
    const Rig rig = ArcRig(n);
    const Eigen::Vector3d point(300, -500, 11800);
    std::vector<Sighting> sightings = Sight(rig, point, 0.0, &random);
    for (Sighting& s : sightings) s.cov_px2.setIdentity();
    Intersection result;
    ASSERT_EQ(Intersect(rig, sightings, &result), IntersectionStatus::kOk);
    // Pixels are good to 1e-10; a pixel is 4.5 mm here, depth twice that.
    EXPECT_LT((result.position_mm - point).norm(), 1e-7);
  }
}

// The normalised squared error is chi-square with 3 degrees of freedom: the
// mean of m trials is 3 +- sqrt(6/m); chi2 of the residuals has 2n - 3 alike.
TEST(Intersection, CovarianceIsTheScatter) {
  constexpr int kTrials = 4000;
  for (const int n : {2, 4}) {
    for (const unsigned seed : {11U, 12U}) {
      std::mt19937 random(seed);
      const Rig rig = ArcRig(n);
      const Eigen::Vector3d point(-800, 900, 12500);
      double error = 0, chi2 = 0;
      for (int i = 0; i < kTrials; ++i) {
        Intersection result;
        ASSERT_EQ(Intersect(rig, Sight(rig, point, 0.05, &random), &result),
                  IntersectionStatus::kOk);
        const Eigen::Vector3d d = result.position_mm - point;
        error += d.dot(result.cov_mm2.inverse() * d) / kTrials;
        chi2 += result.chi2 / kTrials;
      }
      const double dof = 2 * n - 3;
      EXPECT_NEAR(error, 3.0, 4 * std::sqrt(6.0 / kTrials)) << n << " cameras, seed " << seed;
      EXPECT_NEAR(chi2, dof, 4 * std::sqrt(2 * dof / kTrials)) << n << " cameras, seed " << seed;
    }
  }
}

TEST(Intersection, SaysWhyItFails) {
  const Rig rig = ArcRig(2);
  std::mt19937 random(1);
  std::vector<Sighting> sightings = Sight(rig, {0, 0, 12000}, 0.01, &random);
  Intersection result;
  EXPECT_EQ(Intersect(rig, std::span(sightings).first(1), &result),
            IntersectionStatus::kTooFewRays);
  const std::vector<Sighting> twice = {sightings[0], sightings[0]};
  EXPECT_EQ(Intersect(rig, twice, &result), IntersectionStatus::kParallelRays);
  // Rays that part in front of the cameras meet behind them.
  std::vector<Sighting> parting = sightings;
  parting[0].pixel.x() -= 800;
  parting[1].pixel.x() += 800;
  std::vector<Sighting> crossing = sightings;
  crossing[0].pixel.x() += 800;
  crossing[1].pixel.x() -= 800;
  const bool first = Intersect(rig, parting, &result) == IntersectionStatus::kBehindCamera;
  const bool second = Intersect(rig, crossing, &result) == IntersectionStatus::kBehindCamera;
  EXPECT_NE(first, second);
}

}  // namespace
}  // namespace videogrammetry
