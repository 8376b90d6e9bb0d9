#include "videogrammetry/adjustment/resection.h"

#include <gtest/gtest.h>

#include "synthetic.h"
#include "videogrammetry/adjustment/focal_search.h"
#include "videogrammetry/adjustment/p3p.h"
#include "videogrammetry/core/errors.h"

namespace videogrammetry {
namespace {

struct View {
  Camera camera;
  Rigid3 pose;
  Points3d points;
  Points2d pixels;
};

View MakeView(unsigned seed, int count, double relief_mm, double f_px, double distance_mm,
              double noise_px) {
  std::mt19937 random(seed);
  View v{synthetic::MakeCamera(f_px),
         {RotationFromVector(synthetic::UniformVector(&random, 0.6)), {20, -30, distance_mm}},
         Points3d(count, 3),
         Points2d(count, 2)};
  for (int i = 0; i < count; ++i) {
    v.points.row(i) << synthetic::Uniform(&random, 300), synthetic::Uniform(&random, 300),
        synthetic::Uniform(&random, relief_mm);
    const Eigen::Vector3d p = v.pose * v.points.row(i).transpose();
    v.pixels.row(i) = Project(v.camera, p)->transpose();
    for (int k = 0; k < 2; ++k) v.pixels(i, k) += synthetic::Normal(&random, noise_px);
  }
  return v;
}

double AngleTo(const Rigid3& a, const Rigid3& b) {
  return VectorFromRotation(a.rotation * b.rotation.transpose()).norm();
}

TEST(P3p, OneOfThePosesIsTheTruth) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    std::mt19937 random(seed);
    const Rigid3 pose{RotationFromVector(synthetic::UniformVector(&random, 0.7)), {50, 60, 1500}};
    Eigen::Matrix3d points, rays;
    for (int k = 0; k < 3; ++k) {
      points.col(k) = synthetic::UniformVector(&random, 300);
      rays.col(k) = (pose * points.col(k)).normalized();
    }
    double best = 1e9;
    for (const Rigid3& p : SolveP3P(points, rays)) best = std::min(best, AngleTo(p, pose));
    // A quartic's root loses at most half of the digits at a double root.
    EXPECT_LT(best, 1e-6) << "seed " << seed;
  }
}

TEST(P3p, CollinearPointsHaveNoPose) {
  Eigen::Matrix3d points;
  points << 0, 1, 2, 0, 1, 2, 0, 0, 0;
  EXPECT_TRUE(SolveP3P(points, Eigen::Matrix3d::Identity()).empty());
}

// A third of the numbers wrong. The rotation's error of a resection is about
// sigma / (f * size / distance) / sqrt(N) * (a few for the tilt): 10 such.
TEST(Resect, FindsThePoseAmongWrongNumbers) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const double noise = 0.05, f = 2000, distance = 2500;
    View v = MakeView(seed, 30, 60, f, distance, noise);
    for (int i = 0; i < 30; i += 3) v.pixels.row(i) = v.pixels.row((i + 7) % 30).eval();
    const auto found = Resect(v.camera, v.points, v.pixels, {});
    ASSERT_FALSE(found.empty()) << "seed " << seed;
    const double bound = 10 * noise / (f * 300 / distance) / std::sqrt(20.0) * (distance / 300);
    EXPECT_LT(AngleTo(found[0].cam_from_object, v.pose), bound) << "seed " << seed;
    EXPECT_GE(found[0].inliers, 20) << "seed " << seed;
  }
}

// Flat and narrow: the mirrored pose is a second minimum; one of the two
// returned is the truth, the other not.
TEST(Resect, GivesBothPosesOfAFlatTargetInANarrowField) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const View v = MakeView(seed, 25, 0.0, 8000, 12000, 0.3);
    const auto found = Resect(v.camera, v.points, v.pixels, {});
    ASSERT_EQ(found.size(), 2u) << "seed " << seed;
    const double first = AngleTo(found[0].cam_from_object, v.pose);
    const double second = AngleTo(found[1].cam_from_object, v.pose);
    EXPECT_LT(std::min(first, second), 0.03) << "seed " << seed;
    EXPECT_GT(std::max(first, second), 0.1) << "seed " << seed;
  }
}

TEST(Resect, TooFewPointsGiveNothing) {
  const View v = MakeView(1, 3, 50, 2000, 2500, 0.0);
  EXPECT_TRUE(Resect(v.camera, v.points, v.pixels, {}).empty());
}

// Narrow (f = 8 picture widths) to wide. The search need only be a start: 5 %.
TEST(FocalSearch, FindsFWithoutAStart) {
  for (const double f : {500.0, 1500.0, 8000.0}) {
    std::vector<ResectionView> views;
    Camera camera = synthetic::MakeCamera(f);
    for (unsigned seed = 1; seed <= 5; ++seed) {
      const View v = MakeView(seed, 30, 120, f, 1.2 * f, 0.02);
      views.push_back({v.points, v.pixels});
      camera = v.camera;
    }
    camera.interior[kF] = 1000;
    const FocalSearchResult r = SearchFocal(camera, views, 14.0);
    EXPECT_NEAR(r.f_px, f, 0.05 * f);
    EXPECT_GT(r.contrast, 1.5);
  }
}

TEST(FocalSearch, NoiseHasNoFocalLength) {
  std::mt19937 random(3);
  ResectionView view{Points3d(20, 3), Points2d(20, 2)};
  for (int i = 0; i < 20; ++i) {
    view.points_mm.row(i) = synthetic::UniformVector(&random, 300).transpose();
    view.pixels.row(i) << 512 + synthetic::Uniform(&random, 500),
        512 + synthetic::Uniform(&random, 500);
  }
  Camera camera = synthetic::MakeCamera(1000);
  double rms = 1e9;
  try {
    rms = SearchFocal(camera, {view}, 14.0).rms_px;
  } catch (const AdjustmentError&) {
  }
  EXPECT_GT(rms, 10.0);  // at best a few points fit by chance
}

}  // namespace
}  // namespace videogrammetry
