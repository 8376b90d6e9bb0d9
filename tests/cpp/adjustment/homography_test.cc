#include "videogrammetry/adjustment/homography.h"

#include <gtest/gtest.h>

#include "synthetic.h"

namespace videogrammetry {
namespace {

Eigen::Matrix3d PlaneHomography(const Rigid3& pose, double f_px) {
  Eigen::Matrix3d h;
  h << pose.rotation.col(0), pose.rotation.col(1), pose.translation_mm;
  return Eigen::Vector3d(f_px, f_px, 1).asDiagonal() * h;
}

TEST(Homography, ExactPicturesGivePoseAndFocal) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    std::mt19937 random(seed);
    std::vector<Eigen::Matrix3d> all;
    for (int i = 0; i < 3; ++i) {
      const Rigid3 pose{RotationFromVector(synthetic::UniformVector(&random, 0.6)), {30, 40, 3000}};
      const Eigen::Matrix3d h = PlaneHomography(pose, 1800);
      Points2d plane(9, 2), pixels(9, 2);
      for (int p = 0; p < 9; ++p) {
        plane.row(p) << 300.0 * (p % 3), 250.0 * (p / 3);
        pixels.row(p) = (h * plane.row(p).transpose().homogeneous()).hnormalized().transpose();
      }
      const auto fitted = FitHomography(plane, pixels);
      ASSERT_TRUE(fitted) << "seed " << seed;
      const Rigid3 found = PoseFromHomography(*fitted, 1800);
      EXPECT_LT((found.rotation - pose.rotation).norm(), 1e-6) << "seed " << seed;
      EXPECT_LT((found.translation_mm - pose.translation_mm).norm(), 1e-3) << "seed " << seed;
      all.push_back(*fitted);
    }
    const auto f = FocalFromHomographies(all);
    ASSERT_TRUE(f) << "seed " << seed;
    EXPECT_NEAR(*f, 1800, 1e-3) << "seed " << seed;
  }
}

TEST(Homography, SquareViewSaysNothingAboutF) {
  const Rigid3 square{Eigen::Matrix3d::Identity(), {0, 0, 1000}};
  EXPECT_FALSE(FocalFromHomographies({PlaneHomography(square, 1500)}));
}

TEST(Homography, CollinearPointsAreRefused) {
  Points2d line(5, 2), pixels(5, 2);
  for (int i = 0; i < 5; ++i) {
    line.row(i) << i, 2 * i;
    pixels.row(i) << 3 * i, i;
  }
  EXPECT_FALSE(FitHomography(line, pixels));
  EXPECT_THROW(FitHomography(line.topRows(3), pixels.topRows(3)), std::invalid_argument);
}

// Flipping twice is the pose itself, and the flipped pose keeps the plane's
// points where they were but for perspective: second order in size / distance.
TEST(Homography, FlippedPoseIsAnInvolutionAndFitsWeakPerspective) {
  const Rigid3 pose{RotationFromVector({0.3, -0.4, 0.1}), {100, 50, 20000}};
  const Eigen::Vector3d centre(10, -20, 0), normal = Eigen::Vector3d::UnitZ();
  const Rigid3 flipped = FlippedPose(pose, centre, normal);
  const Rigid3 twice = FlippedPose(flipped, centre, normal);
  EXPECT_NEAR(flipped.rotation.determinant(), 1.0, 1e-12);
  EXPECT_LT((twice.rotation - pose.rotation).norm(), 1e-12);
  EXPECT_GT((flipped.rotation - pose.rotation).norm(), 0.5);
  const double f = 5000, size = 100, distance = 20000;
  for (const Eigen::Vector3d& x : {Eigen::Vector3d(size, 0, 0), Eigen::Vector3d(0, size, 0)}) {
    const Eigen::Vector3d a = pose * x, b = flipped * x;
    const double moved = (f * a.head<2>() / a.z() - f * b.head<2>() / b.z()).norm();
    EXPECT_LT(moved, 4 * f * size * size / (distance * distance));
  }
}

}  // namespace
}  // namespace videogrammetry
