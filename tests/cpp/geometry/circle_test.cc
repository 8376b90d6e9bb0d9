#include "videogrammetry/geometry/circle.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <utility>

#include "videogrammetry/geometry/circle_normal.h"

namespace videogrammetry {
namespace {

Camera Pinhole(double f_px) {
  Camera camera{1024, 1024, {}, 400.0, DistortionDirection::kMeasured};
  camera.interior.setZero();
  camera.interior[kF] = f_px;
  return camera;
}

Camera PaperLens(DistortionDirection direction) {
  Camera camera{1024, 1024, {}, 400.0, direction};
  camera.interior << 2650, -40, 30, 1.2e-8, 3e-15, 1e-20, 2e-7, 3e-6, -0.0023, 3e-4;
  return camera;
}

Eigen::Vector3d Tilted(double tilt, double azimuth) {
  return {std::sin(tilt) * std::cos(azimuth), std::sin(tilt) * std::sin(azimuth), -std::cos(tilt)};
}

/// The circle's conic in the picture, through the homography of its plane.
Ellipse ConicOf(double f_px, const Circle& circle) {
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(circle.normal);
  Eigen::Matrix3d calibration, plane;
  calibration << f_px, 0, 511.5, 0, f_px, 511.5, 0, 0, 1;
  plane << circle.radius_mm * basis, circle.center_mm;
  const Eigen::Matrix3d inverse = (calibration * plane).inverse();
  return *EllipseFromConic(inverse.transpose() * Eigen::Vector3d(1, 1, -1).asDiagonal() * inverse);
}

TEST(Circle, CentreAndShapeAreThoseOfTheConic) {
  for (const double tilt : {0.0, 0.5, 1.1}) {
    for (const double x : {0.0, 150.0, 300.0}) {
      const Circle circle{{x, -0.6 * x, 900}, Tilted(tilt, 0.7), 20};
      const Ellipse exact = ConicOf(1200, circle);
      const auto center = ProjectEllipseCenter(Pinhole(1200), circle);
      const auto shape = ProjectedShape(circle);
      ASSERT_TRUE(center && shape);
      // The conic's own entries are of the order (500 / 25)^2: 1e-9 px of rounding.
      EXPECT_NEAR(center->x(), exact.x_px, 1e-8);
      EXPECT_NEAR(center->y(), exact.y_px, 1e-8);
      const double c = std::cos(exact.angle_rad), s = std::sin(exact.angle_rad);
      const double a2 = std::pow(exact.semi_major_px / 1200, 2);
      const double b2 = std::pow(exact.semi_minor_px / 1200, 2);
      EXPECT_NEAR((*shape)[0], a2 * c * c + b2 * s * s, 1e-9 * a2);
      EXPECT_NEAR((*shape)[1], (a2 - b2) * c * s, 1e-9 * a2);
      EXPECT_NEAR((*shape)[2], a2 * s * s + b2 * c * c, 1e-9 * a2);
    }
  }
}

TEST(Circle, OnTheAxisItIsTheKnownFormula) {
  // d^2 / (4 f) sin t cos t, to a relative (r / z)^2 = 1e-4.
  const double f = 1500, z = 1000, r = 10, t = 0.6;
  const auto center = ProjectEllipseCenter(Pinhole(f), {{0, 0, z}, Tilted(t, 0), r});
  const double d_px = 2 * r * f / z;
  const double known = d_px * d_px / (4 * f) * std::sin(t) * std::cos(t);
  EXPECT_NEAR(std::abs(center->x() - 511.5), known, 2e-4 * known);
}

// The shift by the distortion's curvature is constant in the derivatives: of a dot of
// 16 px radius 500 px off the axis it is 5e-3 px and grows as the distance does, so that
// a mm (1 px) changes it by 1e-5 px, 5e-5 where the third order joins in.
TEST(Circle, JacobiansEqualDifferences) {
  for (const auto direction : {DistortionDirection::kMeasured, DistortionDirection::kIdeal}) {
    const Camera camera = PaperLens(direction);
    const Circle circle{{400, -300, 2500}, Tilted(0.7, 1.9), 15};
    EllipseCenterJacobians j;
    Eigen::Matrix<double, 3, 4> by_shape;
    ASSERT_TRUE(ProjectEllipseCenter(camera, circle, &j));
    ASSERT_TRUE(ProjectedShape(circle, &by_shape));
    for (int k = 0; k < 3; ++k) {
      auto at = [&](double center, double normal) {
        Circle moved = circle;
        moved.center_mm[k] += center;
        moved.normal[k] += normal;
        return moved;
      };
      const double h = 1e-3;
      const Eigen::Vector2d by_center =
          (*ProjectEllipseCenter(camera, at(h, 0)) - *ProjectEllipseCenter(camera, at(-h, 0))) /
          (2 * h);
      const Eigen::Vector2d by_normal =
          (*ProjectEllipseCenter(camera, at(0, h)) - *ProjectEllipseCenter(camera, at(0, -h))) /
          (2 * h);
      const Eigen::Vector3d shape =
          (*ProjectedShape(at(0, h)) - *ProjectedShape(at(0, -h))) / (2 * h);
      EXPECT_LT((j.by_center.col(k) - by_center).norm(), 5e-5) << k;
      // The curvature's shift, 2e-3 px here, turns with the normal too.
      EXPECT_LT((j.by_normal.col(k) - by_normal).norm(), 5e-3) << k;
      EXPECT_LT((by_shape.col(k) - shape).norm(), 1e-6 * by_shape.norm()) << k;
    }
    Circle larger = circle, smaller = circle;
    larger.radius_mm *= std::exp(1e-4);
    smaller.radius_mm *= std::exp(-1e-4);
    const Eigen::Vector3d by_log = (*ProjectedShape(larger) - *ProjectedShape(smaller)) / 2e-4;
    EXPECT_LT((by_shape.col(3) - by_log).norm(), 1e-6 * by_log.norm());
  }
}

TEST(Circle, BadInputIsNamed) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((Circle{{0, 0, 1}, {0, 0, 1}, -1}.Check("circle")), std::invalid_argument);
  EXPECT_THROW((Circle{{0, 0, 1}, {0, 0, 1}, nan}.Check("circle")), std::invalid_argument);
  EXPECT_THROW((Circle{{0, 0, 1}, {0, 0, 0}, 1}.Check("circle")), std::invalid_argument);
  EXPECT_THROW((Circle{{0, 0, 1}, {0, nan, 1}, 1}.Check("circle")), std::invalid_argument);
  EXPECT_THROW((Circle{{0, nan, 1}, {0, 0, 1}, 1}.Check("circle")), std::invalid_argument);
  // Edge on, reaching to the camera's plane.
  EXPECT_FALSE(ProjectEllipseCenter(Pinhole(1000), {{0, 0, 5}, {1, 0, 0}, 6}));
}

Rig Two(double angle, const Camera& camera) {
  Rig rig;
  for (const double turn : {-0.5 * angle, 0.5 * angle}) {
    const Eigen::Matrix3d rotation = RotationFromVector({0, turn, 0});
    const Eigen::Vector3d aim(0, 0, 2000);
    rig.push_back({camera, Rigid3{rotation, aim - rotation * aim}});
  }
  return rig;
}

EllipseSighting See(const OrientedCamera& oriented, int camera, const Circle& world) {
  const Circle in_cam{oriented.cam_from_world * world.center_mm,
                      oriented.cam_from_world.rotation * world.normal, world.radius_mm};
  EllipseSighting s;
  s.camera = camera;
  s.ellipse = ConicOf(oriented.camera.f_px(), in_cam);
  return s;
}

// Axes and angle with the noise of an edge fit; the covariance of the angle is
// sigma^2 a b / (a^2 - b^2)^2 to a factor near 1.
void AddNoise(double sigma, std::mt19937* random, EllipseSighting* s) {
  std::normal_distribution<double> unit;
  Ellipse& e = s->ellipse;
  const double part = sigma * (e.semi_major_px + e.semi_minor_px) / 2;
  const double turn = part / (std::pow(e.semi_major_px, 2) - std::pow(e.semi_minor_px, 2));
  s->cov = Eigen::Vector3d(sigma * sigma, sigma * sigma, turn * turn).asDiagonal();
  e.semi_major_px += sigma * unit(*random);
  e.semi_minor_px += sigma * unit(*random);
  e.angle_rad += turn * unit(*random);
}

TEST(EstimateNormal, ComesBackWithoutNoise) {
  const Rig rig = Two(0.5, Pinhole(1500));
  for (const double tilt : {0.0, 0.3, 0.9}) {
    for (const double azimuth : {0.0, 1.0, 2.5, 4.5}) {
      const Circle circle{{80, -60, 2000}, Tilted(tilt, azimuth), 12};
      std::vector<EllipseSighting> seen;
      for (int c = 0; c < 2; ++c) {
        seen.push_back(See(rig[static_cast<std::size_t>(c)], c, circle));
        seen.back().cov = Eigen::Vector3d(1e-8, 1e-8, 1e-8).asDiagonal();
      }
      const auto found = EstimateNormal(rig, seen, circle.center_mm);
      ASSERT_TRUE(found);
      // sigma of 1e-4 px on 9 px: the prior moves by (1e-5 / 0.7)^2, rounding by 1e-6.
      EXPECT_LT((found->normal - circle.normal).norm(), 1e-5) << tilt << " " << azimuth;
      EXPECT_NEAR(found->radius_mm, 12, 1e-4);
    }
  }
}

// Mahalanobis distances of N draws with two degrees of freedom: mean 2, standard
// deviation of the mean 2 / sqrt(N). The covariance itself is of first order in
// sigma / (b tan t): 10 % are left for that.
TEST(EstimateNormal, CovarianceHoldsByMonteCarlo) {
  const Rig rig = Two(0.5, Pinhole(1500));
  constexpr int kDraws = 1500;
  for (const double tilt : {0.25, 0.7}) {
    std::mt19937 random(5);
    const Circle circle{{80, -60, 2000}, Tilted(tilt, 0.8), 12};
    double sum = 0;
    for (int i = 0; i < kDraws; ++i) {
      std::vector<EllipseSighting> seen;
      for (int c = 0; c < 2; ++c) {
        seen.push_back(See(rig[static_cast<std::size_t>(c)], c, circle));
        AddNoise(0.01, &random, &seen.back());
      }
      const auto found = EstimateNormal(rig, seen, circle.center_mm);
      ASSERT_TRUE(found) << "seed 5, draw " << i;
      // Inflation by a large chi2 is for wrong weights; here they are right.
      const double inflated = std::max(1.0, found->chi2 / 3.0);
      const Eigen::Matrix<double, 3, 2> basis = TangentBasis(found->normal);
      const Eigen::Vector2d off = basis.transpose() * (circle.normal - found->normal);
      const Eigen::Matrix2d cov = basis.transpose() * found->cov * basis / inflated;
      sum += off.dot(cov.inverse() * off);
    }
    EXPECT_NEAR(sum / kDraws, 2.0, 5 * 2.0 / std::sqrt(kDraws) + 0.2) << "tilt " << tilt;
  }
}

// Seen squarely by cameras two degrees apart, the tilt shows in second order only: the
// covariance is then that of no Gaussian, and is held to a factor of two.
TEST(EstimateNormal, SquareViewIsNeitherSureNorBlind) {
  const Rig rig = Two(0.035, Pinhole(1500));
  const Circle circle{{0, 0, 2000}, Tilted(0.05, 0.8), 12};
  std::mt19937 random(7);
  std::normal_distribution<double> unit;
  constexpr int kDraws = 500;
  double sum = 0, sigma = 0;
  for (int i = 0; i < kDraws; ++i) {
    std::vector<EllipseSighting> seen;
    for (int c = 0; c < 2; ++c) {
      EllipseSighting s = See(rig[static_cast<std::size_t>(c)], c, circle);
      Ellipse& e = s.ellipse;
      e.semi_major_px += 0.01 * unit(random);
      e.semi_minor_px += 0.01 * unit(random);
      if (e.semi_major_px < e.semi_minor_px) {
        std::swap(e.semi_major_px, e.semi_minor_px);
        e.angle_rad += e.angle_rad < 1.5707963 ? 1.5707963 : -1.5707963;
      }
      s.cov = Eigen::Vector3d(1e-4, 1e-4, 0.25).asDiagonal();
      seen.push_back(s);
    }
    const auto found = EstimateNormal(rig, seen, circle.center_mm);
    ASSERT_TRUE(found) << "seed 7, draw " << i;
    const Eigen::Matrix<double, 3, 2> basis = TangentBasis(found->normal);
    const Eigen::Vector2d off = basis.transpose() * (circle.normal - found->normal);
    const Eigen::Matrix2d cov = basis.transpose() * found->cov * basis;
    sum += off.dot(cov.inverse() * off);
    sigma += std::sqrt(cov.trace()) / kDraws;
  }
  EXPECT_GT(sum / kDraws, 2.0 / 2);
  EXPECT_LT(sum / kDraws, 2.0 * 2);
  // sqrt(0.01 / 9 px) = 0.033 rad an axis.
  EXPECT_LT(sigma, 0.2);
}

TEST(EstimateNormal, OneCameraLeavesBothNormalsOpen) {
  const Rig rig = Two(0.5, Pinhole(1500));
  const Circle circle{{0, 0, 2000}, Tilted(0.6, 0.8), 12};
  std::vector<EllipseSighting> seen = {See(rig[0], 0, circle)};
  seen[0].cov = Eigen::Vector3d(1e-4, 1e-4, 1e-4).asDiagonal();
  const auto found = EstimateNormal(rig, seen, circle.center_mm);
  ASSERT_TRUE(found);
  // Two normals about 2 * 0.3 ... 0.6 rad apart: the truth within two sigmas of their mean.
  const Eigen::Vector3d off = circle.normal - found->normal;
  EXPECT_GT(std::sqrt(found->cov.trace()), 0.3);
  EXPECT_LT(off.norm(), 2 * std::sqrt(found->cov.trace()));
}

TEST(EstimateNormal, NoUsableEllipseIsNone) {
  const Rig rig = Two(0.5, Pinhole(1500));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EllipseSighting flat;
  flat.ellipse = {500, 500, 9, 0, 0};
  EllipseSighting lost = flat;
  lost.ellipse.semi_minor_px = nan;
  EllipseSighting unsure = flat;
  unsure.ellipse.semi_minor_px = 7;
  unsure.cov.setConstant(nan);
  for (const EllipseSighting& s : {flat, lost, unsure}) {
    EXPECT_FALSE(EstimateNormal(rig, std::vector<EllipseSighting>{s}, {0, 0, 2000}));
  }
  EXPECT_FALSE(EstimateNormal(rig, {}, {0, 0, 2000}));
}

}  // namespace
}  // namespace videogrammetry
