#include "videogrammetry/geometry/camera.h"

#include <gtest/gtest.h>

#include <random>

#include "videogrammetry/geometry/rig.h"

namespace videogrammetry {
namespace {

// A lens of the paper's Table 1, all ten parameters at work.
Camera PaperCamera(DistortionDirection direction) {
  Camera camera{1024, 1024, {}, 400.0, direction};
  camera.interior << 2646.306, -56.244, -46.280, -2.172e-8, 6.036e-15, -1.377e-20, 5.986e-7,
      -7.449e-6, -2.293e-2, 5.225e-3;
  return camera;
}

std::vector<Eigen::Vector3d> PointsInView(int count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> across(-2400, 2400), along(9000, 15000);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) {
    const double z = along(random);
    points.emplace_back(across(random) * z / 12000, across(random) * z / 12000, z);
  }
  return points;
}

class BothDirections : public ::testing::TestWithParam<DistortionDirection> {};

TEST_P(BothDirections, RayAndProjectionAreInverse) {
  const Camera camera = PaperCamera(GetParam());
  for (const Eigen::Vector3d& point : PointsInView(500, 1)) {
    const auto pixel = Project(camera, point);
    ASSERT_TRUE(pixel);
    const auto ray = RayThroughPixel(camera, *pixel);
    ASSERT_TRUE(ray);
    // 1e-10 px is promised; x f turns the ray's error into pixels.
    EXPECT_LT((*ray * point.z() - point).norm() / point.z() * camera.f_px(), 1e-9);
  }
}

// Central differences err by (h^2/6) f''' + rounding/h; steps that move the
// picture by some 1e-3 px keep the first under 1e-9 and the second, with 1e-12
// px of rounding, under 1e-9 of the derivative.
TEST_P(BothDirections, JacobiansAgreeWithNumericalOnes) {
  const Camera camera = PaperCamera(GetParam());
  Eigen::Matrix<double, kNumInterior, 1> scale;
  scale << 1, 1, 1, 1e-10, 1e-16, 1e-22, 1e-9, 1e-9, 1e-5, 1e-5;  // about 3e-3 px each
  for (const Eigen::Vector3d& point : PointsInView(50, 2)) {
    ProjectionJacobians jacobians;
    ASSERT_TRUE(Project(camera, point, &jacobians));
    for (int k = 0; k < 3; ++k) {
      Eigen::Vector3d step = Eigen::Vector3d::Zero();
      step[k] = 0.1;
      const Eigen::Vector2d numeric =
          (*Project(camera, point + step) - *Project(camera, point - step)) / 0.2;
      EXPECT_LT((jacobians.by_point.col(k) - numeric).norm(), 1e-6 * jacobians.by_point.norm());
    }
    for (int k = 0; k < kNumInterior; ++k) {
      Camera plus = camera, minus = camera;
      plus.interior[k] += scale[k];
      minus.interior[k] -= scale[k];
      const Eigen::Vector2d numeric =
          (*Project(plus, point) - *Project(minus, point)) / (2 * scale[k]);
      const Eigen::Vector2d analytic = jacobians.by_interior.col(k);
      // The difference quotient's own rounding: 1e-12 px over the step.
      EXPECT_LT((analytic - numeric).norm(), 1e-6 * analytic.norm() + 2e-12 / scale[k])
          << kInteriorNames[static_cast<std::size_t>(k)];
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Directions, BothDirections,
                         ::testing::Values(DistortionDirection::kMeasured,
                                           DistortionDirection::kIdeal));

TEST(Camera, RayJacobianAgreesWithNumericalOne) {
  for (const auto direction : {DistortionDirection::kMeasured, DistortionDirection::kIdeal}) {
    const Camera camera = PaperCamera(direction);
    Eigen::Matrix2d by_pixel;
    const Eigen::Vector2d pixel(812.3, 133.7);
    ASSERT_TRUE(RayThroughPixel(camera, pixel, &by_pixel));
    for (int k = 0; k < 2; ++k) {
      Eigen::Vector2d step = Eigen::Vector2d::Zero();
      step[k] = 1e-2;
      const Eigen::Vector2d numeric = (RayThroughPixel(camera, pixel + step)->head<2>() -
                                       RayThroughPixel(camera, pixel - step)->head<2>()) /
                                      2e-2;
      EXPECT_LT((by_pixel.col(k) - numeric).norm(), 1e-6 * by_pixel.norm());
    }
  }
}

TEST(Camera, SaysSoWhereNoPictureExists) {
  Camera camera = PaperCamera(DistortionDirection::kMeasured);
  EXPECT_FALSE(Project(camera, {0, 0, 0}));
  EXPECT_FALSE(Project(camera, {10, 10, -1000}));
  // measured + A1 r^2 measured with A1 < 0 has a largest ideal radius: beyond
  // it no measured point exists. Here r + A1 r (r^2 - r0^2) peaks near 330 px.
  camera.interior << 1000, 0, 0, -3e-6, 0, 0, 0, 0, 0, 0;
  EXPECT_TRUE(Project(camera, {100, 0, 1000}));
  EXPECT_FALSE(Project(camera, {900, 0, 1000}));
}

TEST(Camera, PoseJacobianAgreesWithNumericalOne) {
  OrientedCamera oriented{PaperCamera(DistortionDirection::kMeasured),
                          Rigid3{RotationFromVector({0.3, -0.2, 0.1}), {100, -200, 300}}};
  const Eigen::Vector3d point(500, 800, 12000);
  OrientedJacobians jacobians;
  ASSERT_TRUE(ProjectFromWorld(oriented, point, &jacobians));
  for (int k = 0; k < 6; ++k) {
    const double step = k < 3 ? 1e-5 : 0.1;
    auto moved = [&](double sign) {
      Eigen::Vector3d vector = Eigen::Vector3d::Zero();
      vector[k % 3] = sign * step;
      OrientedCamera copy = oriented;
      if (k < 3) {
        copy.cam_from_world.rotation = RotationFromVector(vector) * copy.cam_from_world.rotation;
      } else {
        copy.cam_from_world.translation_mm += vector;
      }
      return *ProjectFromWorld(copy, point);
    };
    const Eigen::Vector2d numeric = (moved(1) - moved(-1)) / (2 * step);
    const Eigen::Vector2d analytic = jacobians.by_camera.col(kNumInterior + k);
    EXPECT_LT((analytic - numeric).norm(), 1e-6 * analytic.norm()) << "parameter " << k;
  }
}

}  // namespace
}  // namespace videogrammetry
