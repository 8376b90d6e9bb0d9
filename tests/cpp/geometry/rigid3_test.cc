#include "videogrammetry/geometry/rigid3.h"

#include <gtest/gtest.h>

#include <numbers>
#include <random>
#include <stdexcept>

namespace videogrammetry {
namespace {

TEST(Rigid3, VectorAndMatrixAreInverse) {
  for (const double angle : {0.0, 1e-9, 1e-5, 0.3, 2.0, std::numbers::pi - 1e-7}) {
    const Eigen::Vector3d vector = angle * Eigen::Vector3d(2, -1, 3).normalized();
    const Eigen::Matrix3d rotation = RotationFromVector(vector);
    EXPECT_LT((rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-14);
    EXPECT_LT((VectorFromRotation(rotation) - vector).norm(), 1e-12) << angle;
  }
}

TEST(Rigid3, NearestRotationMendsAMeanOfRotations) {
  const Eigen::Matrix3d mean =
      0.5 * (RotationFromVector({0.1, 0, 0}) + RotationFromVector({0.3, 0, 0}));
  const Eigen::Matrix3d rotation = NearestRotation(mean);
  EXPECT_NEAR(rotation.determinant(), 1.0, 1e-14);
  EXPECT_LT((rotation - RotationFromVector({0.2, 0, 0})).norm(), 1e-14);
  // A reflection must not come out, even where it would be nearer.
  EXPECT_NEAR(NearestRotation(Eigen::Vector3d(1, 1, -0.5).asDiagonal()).determinant(), 1, 1e-14);
}

TEST(Rigid3, FitFindsTheMotion) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  Eigen::Matrix<double, Eigen::Dynamic, 3> b(20, 3);
  for (double& value : b.reshaped()) value = 100 * normal(random);
  const Rigid3 truth{RotationFromVector({1.2, -0.5, 2.0}), {10, 20, 30}};
  Eigen::Matrix<double, Eigen::Dynamic, 3> a(20, 3);
  for (int i = 0; i < 20; ++i) a.row(i) = (truth * b.row(i).transpose()).transpose();
  const Rigid3 fit = FitRigid3(a, b);
  EXPECT_LT((fit.rotation - truth.rotation).norm(), 1e-12);
  EXPECT_LT((fit.translation_mm - truth.translation_mm).norm(), 1e-10);
  EXPECT_LT(((fit * fit.Inverse()).translation_mm).norm(), 1e-10);
  EXPECT_THROW(FitRigid3(a.topRows(2), b.topRows(2)), std::invalid_argument);
}

}  // namespace
}  // namespace videogrammetry
