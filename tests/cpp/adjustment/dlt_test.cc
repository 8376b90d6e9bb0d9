#include "videogrammetry/adjustment/dlt.h"

#include <gtest/gtest.h>

#include "synthetic.h"
#include "videogrammetry/core/errors.h"

namespace videogrammetry {
namespace {

struct Case {
  Points3d points;
  Points2d pixels;
  Rigid3 pose;
  Eigen::Matrix3d k;
};

Case MakeCase(unsigned seed, int count, double relief_mm, double noise_px) {
  std::mt19937 random(seed);
  Case c{Points3d(count, 3),
         Points2d(count, 2),
         {RotationFromVector(synthetic::UniformVector(&random, 0.5)), {30, -20, 2500}},
         {}};
  c.k << 2000, 3, 520, 0, 2020, 500, 0, 0, 1;
  for (int i = 0; i < count; ++i) {
    c.points.row(i) << synthetic::Uniform(&random, 400), synthetic::Uniform(&random, 400),
        synthetic::Uniform(&random, relief_mm);
    const Eigen::Vector3d u = c.k * (c.pose * c.points.row(i).transpose());
    c.pixels.row(i) << u.x() / u.z() + synthetic::Normal(&random, noise_px),
        u.y() / u.z() + synthetic::Normal(&random, noise_px);
  }
  return c;
}

// Exact data: the null vector's error is rounding (1e-16) times the condition
// of the normalised system (below 1e6 here, squared by the normal matrix).
TEST(Dlt, ExactPicturesGiveTheCamera) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const Case c = MakeCase(seed, 12, 300, 0.0);
    const DltResult r = DirectLinearTransform(c.points, c.pixels);
    EXPECT_LT((r.calibration - c.k).norm(), 1e-3) << "seed " << seed;
    EXPECT_LT((r.cam_from_object.rotation - c.pose.rotation).norm(), 1e-6) << "seed " << seed;
    EXPECT_LT((r.cam_from_object.translation_mm - c.pose.translation_mm).norm(), 1e-2);
    EXPECT_LT(r.rms_px, 1e-5) << "seed " << seed;
  }
}

// 11 parameters of 2 N coordinates: the residuals' RMS is sigma sqrt(1 - 11/2N),
// its own relative scatter 1/sqrt(2 (2N - 11)); five of these.
TEST(Dlt, NoiseGivesTheExpectedResiduals) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const int n = 60;
    const double sigma = 0.05;
    const Case c = MakeCase(seed, n, 300, sigma);
    const double expected = sigma * std::sqrt(1 - 11.0 / (2 * n));
    // The linear solution minimises an algebraic, not the image distance: 10 % more.
    const double slack = 5 / std::sqrt(2.0 * (2 * n - 11)) + 0.1;
    EXPECT_NEAR(DirectLinearTransform(c.points, c.pixels).rms_px, expected, slack * expected)
        << "seed " << seed;
  }
}

TEST(Dlt, RefusesTooFewPoints) {
  const Case c = MakeCase(1, 5, 300, 0.0);
  EXPECT_THROW(DirectLinearTransform(c.points, c.pixels), std::invalid_argument);
}

TEST(Dlt, RefusesAPlane) {
  const Case c = MakeCase(2, 20, 0.0, 0.02);
  try {
    DirectLinearTransform(c.points, c.pixels);
    FAIL() << "coplanar points were accepted";
  } catch (const AdjustmentError& error) {
    EXPECT_NE(std::string(error.what()).find("coplanar"), std::string::npos) << error.what();
  }
}

TEST(Dlt, RefusesAMirroredTarget) {
  Case c = MakeCase(3, 20, 300, 0.0);
  c.points.col(2) *= -1;
  EXPECT_THROW(DirectLinearTransform(c.points, c.pixels), AdjustmentError);
}

}  // namespace
}  // namespace videogrammetry
