#include <gtest/gtest.h>

#include "synthetic.h"
#include "videogrammetry/adjustment/observation_model.h"

namespace videogrammetry {
namespace {

struct State {
  Camera camera;
  Rigid3 outer, inner;
  Eigen::Vector3d point;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double radius_mm = 0;
  Sampling sampling{0.03, 0.4, {2.0, -5.0}};
  bool corrected = false;
  Eigen::Vector2d xy_px = Eigen::Vector2d::Zero();
};

std::optional<Eigen::Vector2d> Predict(const State& s, ImagePointJacobians* j) {
  auto pixel = PredictImagePoint(s.camera, &s.outer, s.inner, {s.point, s.normal, s.radius_mm},
                                 s.sampling, j);
  if (pixel && s.corrected) CountFromCorrected(s.camera, s.sampling, s.xy_px, true, &*pixel, j);
  return pixel;
}

Eigen::Vector2d Predict(const State& s) { return *Predict(s, nullptr); }

Rigid3 Moved(const Rigid3& pose, int k, double step) {
  Rigid3 moved = pose;
  if (k < 3) {
    moved.rotation = RotationFromVector(step * Eigen::Vector3d::Unit(k)) * pose.rotation;
  } else {
    moved.translation_mm[k - 3] += step;
  }
  return moved;
}

// Central differences with Richardson's step (error h^4): on values of 1e3 px
// rounding is 1e-13 / h relative to a change of about one pixel a unit step,
// so a step that moves the point by some pixels leaves errors near 1e-9, well
// below the 1e-6 that is asked.
template <typename Change>
Eigen::Vector2d Numerical(const Change& change, double h) {
  const Eigen::Vector2d d1 = (change(h) - change(-h)) / (2 * h);
  const Eigen::Vector2d d2 = (change(2 * h) - change(-2 * h)) / (4 * h);
  return (4 * d1 - d2) / 3;
}

void ExpectClose(const Eigen::Vector2d& analytic, const Eigen::Vector2d& numerical,
                 const std::string& what) {
  EXPECT_LT((analytic - numerical).norm(), 1e-6 * (numerical.norm() + 1e-12)) << what;
}

/// Of points (radius 0) and of circles whose lens only shears and stretches: the shift that
/// a lens' curvature gives an ellipse's centre is left out of the derivatives.
void CheckJacobians(double radius_mm, bool corrected = false) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    std::mt19937 random(seed);
    State s;
    s.camera = synthetic::MakeCamera(2000);
    if (seed % 2 == 0 && !corrected) s.camera.direction = DistortionDirection::kIdeal;
    s.outer = {RotationFromVector(synthetic::UniformVector(&random, 0.5)), {100, -50, 200}};
    s.inner = {RotationFromVector(synthetic::UniformVector(&random, 0.3)), {20, 30, 3000}};
    s.outer.translation_mm += s.inner.translation_mm - s.outer.rotation * s.inner.translation_mm;
    s.point = synthetic::UniformVector(&random, 400);
    s.radius_mm = radius_mm;
    if (radius_mm > 0) {
      s.normal = (Eigen::Vector3d(0, 0, -1) + synthetic::UniformVector(&random, 0.5)).normalized();
      s.camera.interior.segment<5>(kA1).setZero();
    }
    s.xy_px = Predict(s) + Eigen::Vector2d(12.0, -7.0);
    s.corrected = corrected;
    ImagePointJacobians j;
    ASSERT_TRUE(Predict(s, &j)) << "seed " << seed;
    const InteriorVector scale = InteriorScale(s.camera);
    const std::string name = "seed " + std::to_string(seed) + " ";
    for (int k = 0; k < kNumInterior; ++k) {
      if (radius_mm > 0 && k >= kA1 && k <= kB2) continue;
      auto change = [&](double h) {
        State t = s;
        t.camera.interior[k] += h;
        return Predict(t);
      };
      const double h = scale[k] * (k <= kY0 ? 1.0 : 1e-3);
      ExpectClose(j.by_camera.col(k), Numerical(change, h), name + kInteriorNames[k]);
    }
    auto aspect = [&](double h) {
      State t = s;
      t.sampling.aspect += h;
      return Predict(t);
    };
    auto time_offset = [&](double h) {
      State t = s;
      t.sampling.time_offset += h;
      return Predict(t);
    };
    ExpectClose(j.by_camera.col(kAspect), Numerical(aspect, 1e-3), name + "aspect");
    ExpectClose(j.by_camera.col(kTimeOffset), Numerical(time_offset, 0.1), name + "time offset");
    for (int k = 0; k < 6; ++k) {
      const double h = k < 3 ? 1e-3 : 1.0;
      auto outer = [&](double step) {
        State t = s;
        t.outer = Moved(s.outer, k, step);
        return Predict(t);
      };
      auto inner = [&](double step) {
        State t = s;
        t.inner = Moved(s.inner, k, step);
        return Predict(t);
      };
      ExpectClose(j.by_outer.col(k), Numerical(outer, h), name + "outer " + std::to_string(k));
      ExpectClose(j.by_inner.col(k), Numerical(inner, h), name + "inner " + std::to_string(k));
    }
    for (int k = 0; k < 3; ++k) {
      auto change = [&](double step) {
        State t = s;
        t.point[k] += step;
        return Predict(t);
      };
      ExpectClose(j.by_point.col(k), Numerical(change, 1.0), name + "point");
    }
  }
}

TEST(ObservationModel, JacobiansEqualDifferences) { CheckJacobians(0); }

TEST(ObservationModel, JacobiansOfCirclesEqualDifferences) { CheckJacobians(40); }

TEST(ObservationModel, JacobiansOfCorrectedResidualsEqualDifferences) { CheckJacobians(0, true); }

// f (X, Y) / Z over the scale in the middle is what a polynomial without r0 corrects to:
// the residual, in pixel heights, is the difference from it.
TEST(ObservationModel, CorrectedResidualByHand) {
  Camera camera = synthetic::MakeCamera(2000);
  const Rigid3 inner{Eigen::Matrix3d::Identity(), {10, 20, 2000}};
  const Eigen::Vector3d point(350, -230, 10);
  const Sampling sampling{0.02};
  auto pixel = PredictImagePoint(camera, nullptr, inner, {point}, sampling);
  ASSERT_TRUE(pixel);
  const Eigen::Vector2d xy_px = *pixel + Eigen::Vector2d(3.0, -2.0);
  CountFromCorrected(camera, sampling, xy_px, false, &*pixel);
  const double r2 = camera.r0_px * camera.r0_px;
  const double k = 1 - camera.interior[kA1] * r2 - camera.interior[kA2] * r2 * r2 -
                   camera.interior[kA3] * r2 * r2 * r2;
  Camera other = camera;
  other.interior.segment<5>(kA1) /= k;
  other.r0_px = 0;
  Eigen::Vector2d p = xy_px - camera.principal_point_px();
  p.y() *= 1.02;
  const Eigen::Vector3d in_cam = inner * point;
  other.interior.segment<2>(kE1) /= k;
  Eigen::Vector2d expected =
      p + Distortion(other, p) - camera.f_px() / k * in_cam.head<2>() / in_cam.z();
  expected /= 1.02;
  EXPECT_LT((xy_px - *pixel - expected).norm(), 1e-9);
}

// Pixels twice as high as wide: half as many rows from the principal point, and a point
// that moves by 4 px between pictures is 1 px further after a quarter of that time.
TEST(ObservationModel, SamplingByHand) {
  const Camera camera = synthetic::MakeCamera(2000);
  const Rigid3 inner{Eigen::Matrix3d::Identity(), {10, 20, 2000}};
  const Circle mark{{50, -230, 10}};
  const auto square = PredictImagePoint(camera, nullptr, inner, mark);
  const auto high = PredictImagePoint(camera, nullptr, inner, mark, {1.0, 0.25, {4.0, 0.0}});
  ASSERT_TRUE(square && high);
  const double centre = camera.principal_point_px().y();
  EXPECT_DOUBLE_EQ(high->x(), square->x() + 1.0);
  EXPECT_DOUBLE_EQ(high->y() - centre, 0.5 * (square->y() - centre));
}

TEST(ObservationModel, WithoutOuterPoseIsIdentity) {
  const Camera camera = synthetic::MakeCamera(2000);
  const Rigid3 identity, inner{Eigen::Matrix3d::Identity(), {10, 20, 2000}};
  const Eigen::Vector3d point(50, -30, 10);
  const auto with = PredictImagePoint(camera, &identity, inner, {point});
  const auto without = PredictImagePoint(camera, nullptr, inner, {point});
  ASSERT_TRUE(with && without);
  EXPECT_EQ(*with, *without);
}

}  // namespace
}  // namespace videogrammetry
