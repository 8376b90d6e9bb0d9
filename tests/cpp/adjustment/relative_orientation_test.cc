#include "videogrammetry/adjustment/relative_orientation.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "synthetic.h"
#include "videogrammetry/adjustment/five_point.h"

namespace videogrammetry {
namespace {

Eigen::Matrix3d Essential(const Rigid3& pose) {
  const Eigen::Vector3d t = pose.translation_mm.normalized();
  Eigen::Matrix3d cross;
  cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  return cross * pose.rotation;
}

double AngleTo(const Rigid3& a, const Rigid3& b) {
  return VectorFromRotation(a.rotation * b.rotation.transpose()).norm();
}

struct Pair {
  Rigid3 b_from_a;
  Eigen::MatrixX3d a, b;  // rays, z = 1
};

Pair MakePair(unsigned seed, Eigen::Index count, double relief) {
  std::mt19937 random(seed);
  Pair p{{RotationFromVector(synthetic::UniformVector(&random, 0.4)),
          Eigen::Vector3d(-1, 0.2, 0.1) + synthetic::UniformVector(&random, 0.3)},
         Eigen::MatrixX3d(count, 3),
         Eigen::MatrixX3d(count, 3)};
  const Eigen::Matrix3d tilt = RotationFromVector(synthetic::UniformVector(&random, 0.5));
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector3d flat(synthetic::Uniform(&random, 1.5), synthetic::Uniform(&random, 1.5),
                               synthetic::Uniform(&random, relief));
    const Eigen::Vector3d x = tilt * flat + Eigen::Vector3d(0, 0, 6), y = p.b_from_a * x;
    p.a.row(i) = x.transpose() / x.z();
    p.b.row(i) = y.transpose() / y.z();
  }
  return p;
}

// Every solution obeys the five equations and the constraints of an essential
// matrix; one is the truth. A tenfold root of the eigenproblem loses half of the
// digits at worst: 1e-6.
TEST(FivePoint, OneSolutionIsTheTruthAndAllAreEssential) {
  for (unsigned seed = 1; seed <= 50; ++seed) {
    const Pair p = MakePair(seed, 5, 1.0);
    const auto found = EssentialFromFive(p.a.transpose(), p.b.transpose());
    ASSERT_FALSE(found.empty()) << "seed " << seed;
    const Eigen::Matrix3d truth = Essential(p.b_from_a).normalized();
    double best = 1e9;
    for (const Eigen::Matrix3d& e : found) {
      best = std::min({best, (e - truth).norm(), (e + truth).norm()});
      for (int i = 0; i < 5; ++i)
        EXPECT_NEAR((p.b.row(i) * e * p.a.row(i).transpose())(0), 0, 1e-9);
      const Eigen::Matrix3d ee = e * e.transpose();
      EXPECT_LT((2 * ee * e - ee.trace() * e).norm(), 1e-5) << "seed " << seed;
    }
    EXPECT_LT(best, 1e-6) << "seed " << seed;
  }
}

TEST(FivePoint, AnEssentialMatrixHoldsItsMotion) {
  const Pair p = MakePair(3, 5, 1.0);
  double best = 1e9;
  for (const Rigid3& pose : PosesFromEssential(Essential(p.b_from_a))) {
    best =
        std::min(best, AngleTo(pose, p.b_from_a) +
                           (pose.translation_mm - p.b_from_a.translation_mm.normalized()).norm());
  }
  EXPECT_LT(best, 1e-9);
}

// H = R + t n' / d of the plane n'x = d; the truth is one of the two motions.
TEST(FivePoint, AHomographyHoldsItsMotion) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const Pair p = MakePair(seed, 30, 0.0);
    // The plane through three of the points, from their depths in a.
    std::mt19937 random(seed);
    synthetic::UniformVector(&random, 0.4);
    synthetic::UniformVector(&random, 1.0);
    const Eigen::Matrix3d tilt = RotationFromVector(synthetic::UniformVector(&random, 0.5));
    const Eigen::Vector3d n = tilt.col(2);
    const double d = 6 * n.z();
    const Eigen::Matrix3d h = p.b_from_a.rotation + p.b_from_a.translation_mm * n.transpose() / d;
    double best = 1e9;
    for (const Rigid3& pose : PosesFromPlane(-3.7 * h, p.a, p.b)) {
      best =
          std::min(best, AngleTo(pose, p.b_from_a) +
                             (pose.translation_mm - p.b_from_a.translation_mm.normalized()).norm());
    }
    EXPECT_LT(best, 1e-6) << "seed " << seed;
  }
}

TEST(FivePoint, ARotationHoldsNoBaseline) {
  const Pair p = MakePair(1, 10, 0.0);
  EXPECT_TRUE(PosesFromPlane(p.b_from_a.rotation, p.a, p.b).empty());
}

// Distorted, exact pictures with every third number wrong: the motion is exact to
// 1e-10 px of the inverted distortion, 1e-13 rad, times what the geometry (about 100)
// and the convergence of the loss (1e-10 of itself, its root of a step) cost: 1e-6.
// With noise the tests in Python hold the error against its predicted covariance.
TEST(OrientRelatively, FindsTheMotionAmongWrongNumbers) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const Pair p = MakePair(seed, 60, 1.0);
    const Camera camera = synthetic::MakeCamera(1200);
    Points2d a(60, 2), b(60, 2);
    for (Eigen::Index i = 0; i < 60; ++i) {
      a.row(i) = Project(camera, p.a.row(i).transpose())->transpose();
      b.row(i) = Project(camera, p.b.row(i).transpose())->transpose();
    }
    for (Eigen::Index i = 0; i < 60; i += 3) b.row(i) = b.row((i + 7) % 60).eval();
    const RelativeOrientation found = OrientRelatively(camera, a, camera, b, {});
    ASSERT_FALSE(found.candidates.empty()) << "seed " << seed;
    EXPECT_LT(AngleTo(found.candidates[0].b_from_a, p.b_from_a), 1e-6) << "seed " << seed;
    EXPECT_GE(found.candidates[0].inliers, 40) << "seed " << seed;
  }
}

TEST(OrientRelatively, UnequalCountsAreRefused) {
  const Camera camera = synthetic::MakeCamera(1200);
  EXPECT_THROW(OrientRelatively(camera, Points2d(6, 2), camera, Points2d(5, 2), {}),
               std::invalid_argument);
}

}  // namespace
}  // namespace videogrammetry
