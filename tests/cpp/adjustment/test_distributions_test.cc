#include "videogrammetry/adjustment/test_distributions.h"

#include <gtest/gtest.h>

#include <cmath>

namespace videogrammetry {
namespace {

// Tables: P(|N| > 1.959964) = 0.05; Student's t at 0.05 two-sided is 2.570582 for 5 degrees,
// 2.228139 for 10, 1.971957 for 199 and 1.971896 for 200 (on both sides of the series' begin).
TEST(TestDistributions, StudentQuantilesAsInTables) {
  EXPECT_NEAR(StudentQuantile(1.959964, 5), 2.570582, 2e-5);
  EXPECT_NEAR(StudentQuantile(1.959964, 10), 2.228139, 2e-5);
  EXPECT_NEAR(StudentQuantile(1.959964, 199), 1.971957, 2e-5);
  EXPECT_NEAR(StudentQuantile(1.959964, 200), 1.971896, 2e-5);
}

// tau cannot exceed sqrt(r) (one residual bears all of v'Pv) and nears the normal deviate.
TEST(TestDistributions, PopeTauHasItsLimits) {
  EXPECT_LT(PopeTau(3.29, 5), std::sqrt(5.0));
  EXPECT_GT(PopeTau(3.29, 5), 2.0);
  EXPECT_NEAR(PopeTau(3.29, 1000000), 3.29, 1e-4);
  EXPECT_TRUE(std::isinf(PopeTau(3.29, 1)));
}

// chi-square with three degrees: 7.814728 at 0.05, 16.266236 at 0.001 (deviate 3.290527).
TEST(TestDistributions, EquivalentDeviatesAsInTables) {
  EXPECT_NEAR(EquivalentDeviate(7.814728), 1.959964, 1e-5);
  EXPECT_NEAR(EquivalentDeviate(16.266236), 3.290527, 1e-5);
  // Both branches meet to what the leading terms leave out, about 1 / w.
  EXPECT_NEAR(EquivalentDeviate(399.9), EquivalentDeviate(400.1), 0.02);
}

TEST(TestDistributions, DirectionsThatNothingChecksAreLeftOut) {
  const Eigen::Matrix3d scale = Eigen::Matrix3d::Identity();
  const Eigen::Vector3d q(4.0, 1.0, 1e-9);
  EXPECT_NEAR(QuadraticForm({2.0, 3.0, 5.0}, q.asDiagonal(), scale, 1e-6), 10.0, 1e-12);
}

}  // namespace
}  // namespace videogrammetry
