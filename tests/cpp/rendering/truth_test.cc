#include "videogrammetry/rendering/truth.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "scenes.h"
#include "videogrammetry/geometry/circle.h"

namespace videogrammetry {
namespace {

TEST(EllipseOfCircle, IsTheConicWithoutDistortion) {
  const auto camera = scenes::Pinhole(1024, 1200);
  const auto pose = scenes::Before(130, -80, 900, 0.9, 1.1);
  const double radius = 40;
  double error = 1;
  const auto ellipse = EllipseOfCircle(camera, pose, radius, &error);
  // C = H^-T diag(1, 1, -1) H^-1 with H from the plane, in radii, to pixels.
  Eigen::Matrix3d calibration = Eigen::Matrix3d::Identity(), plane;
  calibration << 1200, 0, 511.5, 0, 1200, 511.5, 0, 0, 1;
  plane << radius * pose.x_axis, radius * pose.y_axis(), pose.center_mm;
  const Eigen::Matrix3d inverse = (calibration * plane).inverse();
  const Eigen::Matrix3d conic =
      inverse.transpose() * Eigen::Vector3d(1, 1, -1).asDiagonal() * inverse;
  const auto exact = EllipseFromConic(conic);
  ASSERT_TRUE(ellipse && exact);
  EXPECT_LT(error, 1e-9);
  EXPECT_NEAR(ellipse->x_px, exact->x_px, 1e-8);
  EXPECT_NEAR(ellipse->y_px, exact->y_px, 1e-8);
  EXPECT_NEAR(ellipse->semi_major_px, exact->semi_major_px, 1e-8);
  EXPECT_NEAR(ellipse->semi_minor_px, exact->semi_minor_px, 1e-8);
  EXPECT_NEAR(ellipse->angle_rad, exact->angle_rad, 1e-8);
}

TEST(EllipseOfCircle, StatesHowFarDistortionBendsIt) {
  const auto camera = scenes::PaperCamera();
  double error = 0;
  const auto pose = scenes::Before(1900, 1900, 12000, 0.6, 0.4);
  ASSERT_TRUE(EllipseOfCircle(camera, pose, 45, &error));
  EXPECT_GT(error, 0);
  // Third derivatives of the distortion, about 6 A1 + 60 A3 r^4..., times r^3 / 24 of a dot of
  // 10 px radius in the corner: 3e-4 px here.
  EXPECT_LT(error, 1e-3);
}

// The model that the solvers use against the ellipse fitted to points of the rim, which
// shares nothing with it but the projection of a point. Left out there: the third order
// of the lens' curve and the weights of a flat ellipse's points, a fifth of the second
// order's 0.016 px at the corner and 60 degrees: 3e-3 px at most, and as the square of
// the diameter below.
TEST(EllipseOfCircle, HasTheCentreOfTheExactModel) {
  for (const auto direction : {DistortionDirection::kMeasured, DistortionDirection::kIdeal}) {
    const auto camera = scenes::PaperCamera(direction);
    for (const double radius : {20.0, 68.0}) {  // 9 and 30 px
      for (const double tilt : {0.0, 0.5, 1.05}) {
        for (const double off : {0.0, 900.0, 1900.0}) {
          const auto pose = scenes::Before(off, -0.8 * off, 12000, tilt, 0.7);
          const auto fitted = EllipseOfCircle(camera, pose, radius);
          const auto model =
              ProjectEllipseCenter(camera.camera, {pose.center_mm, pose.normal, radius});
          ASSERT_TRUE(fitted && model);
          const double bound = 1e-5 + 0.2 * std::sin(tilt) * 0.016 * std::pow(radius / 68, 2);
          EXPECT_LT((*model - Eigen::Vector2d(fitted->x_px, fitted->y_px)).norm(), bound + 5e-5)
              << radius << " " << tilt << " " << off;
        }
      }
    }
  }
}

std::vector<Visibility> Seen(const std::vector<SceneTarget>& targets) {
  std::vector<Visibility> seen;
  for (const TargetTruth& t : TruthOf(scenes::PaperCamera(), targets)) seen.push_back(t.visibility);
  return seen;
}

TEST(TruthOf, SaysWhyATargetIsNotSeen) {
  SceneTarget seen, away, behind, outside, cut, far_one, hiding;
  for (SceneTarget* t : {&seen, &away, &behind, &outside, &cut, &far_one, &hiding}) {
    t->radius_mm = 40;
    t->sticker_mm = 80;
  }
  seen.pose = scenes::Before(0, 0, 12000);
  away.pose = scenes::Before(300, 0, 12000, 3.0);
  behind.pose = scenes::Before(0, 300, -12000);
  outside.pose = scenes::Before(5000, 0, 12000);
  cut.pose = scenes::Before((1023.0 - 511.5 + 40) / 2650 * 12000, 500, 12000);
  far_one.pose = scenes::Before(-1000, 600, 12000);
  hiding.pose = scenes::Before(-1000 * 0.9 + 90, 600 * 0.9, 12000 * 0.9);
  const auto all = Seen({seen, away, behind, outside, cut, far_one, hiding});
  EXPECT_EQ(all[0], Visibility::kVisible);
  EXPECT_EQ(all[1], Visibility::kFacingAway);
  EXPECT_EQ(all[2], Visibility::kBehind);
  EXPECT_EQ(all[3], Visibility::kOutside);
  EXPECT_EQ(all[4], Visibility::kCut);
  EXPECT_EQ(all[5], Visibility::kOccluded);
  EXPECT_EQ(all[6], Visibility::kVisible);
}

TEST(TruthOf, IsThatOfTheMiddleOfTheExposure) {
  SceneTarget target;
  target.pose = scenes::Before(0, 0, 12000);
  target.end_pose = scenes::Before(20, 10, 12000);
  SceneTarget middle;
  middle.pose = scenes::Before(10, 5, 12000);
  const auto truth = TruthOf(scenes::PaperCamera(), {target, middle});
  EXPECT_NEAR(truth[0].ellipse->x_px, truth[1].ellipse->x_px, 1e-10);
  EXPECT_NEAR(truth[0].ellipse->y_px, truth[1].ellipse->y_px, 1e-10);
}

}  // namespace
}  // namespace videogrammetry
