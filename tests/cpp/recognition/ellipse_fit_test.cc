#include "videogrammetry/recognition/ellipse_fit.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>

namespace videogrammetry {
namespace {

const Ellipse kTruth{123.4, 56.7, 12.0, 7.5, 0.8};

Points2d PointsOn(const Ellipse& e, int count, double sigma, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0.0, 1.0);
  const EllipseFrame frame = EllipseFrame::From(e);
  Points2d points(count, 2);
  for (int i = 0; i < count; ++i) {
    const double t = 2 * std::numbers::pi * i / count;
    const Eigen::Vector2d u(std::cos(t), std::sin(t));
    points.row(i) = (frame.Point(u) + sigma * noise(random) * frame.Normal(u)).transpose();
  }
  return points;
}

void ExpectNear(const Ellipse& a, const Ellipse& b, double tolerance) {
  EXPECT_NEAR(a.x_px, b.x_px, tolerance);
  EXPECT_NEAR(a.y_px, b.y_px, tolerance);
  EXPECT_NEAR(a.semi_major_px, b.semi_major_px, tolerance);
  EXPECT_NEAR(a.semi_minor_px, b.semi_minor_px, tolerance);
  EXPECT_NEAR(std::remainder(a.angle_rad - b.angle_rad, std::numbers::pi), 0.0, tolerance);
}

TEST(EllipseFitTest, ExactPointsGiveTheEllipse) {
  const auto fitted = FitEllipse(PointsOn(kTruth, 12, 0.0, 1));
  ASSERT_TRUE(fitted.has_value());
  // Fourth powers of 12 px in double precision, conditioned by scaling.
  ExpectNear(*fitted, kTruth, 1e-8);
}

// N points with noise s along the normal: the normal's displacement by a shift
// of the centre is n . dc, so that the bound of the centre's covariance is
// s^2 (sum J^T J)^-1 over the five parameters (NormalJacobian). The direct fit
// may exceed it, because it minimises an algebraic distance, but not by much on
// a whole contour; the RMS of m trials is good to 1/sqrt(2 m) of itself.
TEST(EllipseFitTest, CentreIsAtTheBound) {
  constexpr int kPoints = 60, kTrials = 2000;
  constexpr double kSigma = 0.05;
  const EllipseFrame frame = EllipseFrame::From(kTruth);
  Eigen::Matrix<double, 5, 5> normal = Eigen::Matrix<double, 5, 5>::Zero();
  for (int i = 0; i < kPoints; ++i) {
    const double t = 2 * std::numbers::pi * i / kPoints;
    const auto row = frame.NormalJacobian({std::cos(t), std::sin(t)});
    normal += row.transpose() * row;
  }
  const Eigen::Matrix<double, 5, 5> bound = kSigma * kSigma * normal.inverse();
  Eigen::Vector2d squares = Eigen::Vector2d::Zero();
  for (unsigned trial = 1; trial <= kTrials; ++trial) {
    const auto fitted = FitEllipse(PointsOn(kTruth, kPoints, kSigma, trial));
    ASSERT_TRUE(fitted.has_value()) << "seed " << trial;
    const Eigen::Vector2d error(fitted->x_px - kTruth.x_px, fitted->y_px - kTruth.y_px);
    squares += error.cwiseAbs2() / kTrials;
  }
  for (int k = 0; k < 2; ++k) {
    const double ratio = std::sqrt(squares[k] / bound(k, k));
    EXPECT_GT(ratio, 1.0 - 4 / std::sqrt(2.0 * kTrials)) << "axis " << k;
    EXPECT_LT(ratio, 1.15) << "axis " << k;
  }
}

TEST(EllipseFitTest, OutliersAreLeftOut) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    Points2d points = PointsOn(kTruth, 60, 0.02, seed);
    for (int i = 0; i < 6; ++i) points.row(10 * i) += Eigen::RowVector2d(1.5, -2.0);
    Eigen::ArrayXi inliers;
    const auto fitted = FitEllipseRobust(points, &inliers);
    ASSERT_TRUE(fitted.has_value()) << "seed " << seed;
    EXPECT_EQ(inliers.sum(), 54) << "seed " << seed;
    // 5 sigma of the least certain parameter, about sigma sqrt(5 / N) each.
    ExpectNear(*fitted, kTruth, 5 * 0.02 * std::sqrt(5.0 / 54) * 2);
  }
}

TEST(EllipseFitTest, DegeneratePointsGiveNothing) {
  Points2d line(8, 2);
  for (int i = 0; i < 8; ++i) line.row(i) << i, 2.0 * i + 1;
  EXPECT_FALSE(FitEllipse(line).has_value());
  const Points2d same = Points2d::Constant(8, 2, 3.0);
  EXPECT_FALSE(FitEllipse(same).has_value());
}

TEST(EllipseFitTest, RefusesWhatIsNoInput) {
  EXPECT_THROW(FitEllipse(Points2d::Random(4, 2)), std::invalid_argument);
  Points2d points = PointsOn(kTruth, 8, 0.0, 1);
  points(3, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(FitEllipse(points), std::invalid_argument);
}

TEST(EllipseFrameTest, ConvertsBothWays) {
  ExpectNear(EllipseFrame::From(kTruth).ToEllipse(), kTruth, 1e-12);
}

TEST(EllipseFrameTest, JacobiansAreTheDerivatives) {
  const EllipseFrame frame = EllipseFrame::From(kTruth);
  constexpr double kStep = 1e-6;
  for (int parameter = 0; parameter < 5; ++parameter) {
    Eigen::Matrix<double, 5, 1> step = Eigen::Matrix<double, 5, 1>::Zero();
    step[parameter] = kStep;
    const auto plus = frame.Moved(step), minus = frame.Moved(-step);
    ASSERT_TRUE(plus && minus);
    for (int i = 0; i < 7; ++i) {
      const Eigen::Vector2d u(std::cos(i), std::sin(i));
      const double numeric = frame.Normal(u).dot(plus->Point(u) - minus->Point(u)) / (2 * kStep);
      // Central differences of coordinates of 100 px: 1e-14 * 100 / 1e-6.
      EXPECT_NEAR(frame.NormalJacobian(u)[parameter], numeric, 1e-6);
    }
    const Ellipse a = plus->ToEllipse(), b = minus->ToEllipse();
    const double values[5] = {a.x_px - b.x_px, a.y_px - b.y_px, a.semi_major_px - b.semi_major_px,
                              a.semi_minor_px - b.semi_minor_px, a.angle_rad - b.angle_rad};
    for (int i = 0; i < 5; ++i) {
      EXPECT_NEAR(frame.EllipseJacobian()(i, parameter), values[i] / (2 * kStep), 1e-6);
    }
  }
}

TEST(EllipseFrameTest, RefusesToTurnInsideOut) {
  Eigen::Matrix<double, 5, 1> step;
  step << 0, 0, -100, 0, 0;
  EXPECT_FALSE(EllipseFrame::From(kTruth).Moved(step).has_value());
}

}  // namespace
}  // namespace videogrammetry
