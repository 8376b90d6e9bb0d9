#include "videogrammetry/reconstruction/triangulate.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

namespace videogrammetry {
namespace {

Rig Pair() {
  Rig rig;
  for (const double angle : {-0.25, 0.25}) {
    Camera camera{1024, 1024, {}, 400.0, DistortionDirection::kMeasured};
    camera.interior << 2650, 10, -20, -2e-8, 0, 0, 6e-8, -7e-7, 0, 0;
    const Eigen::Matrix3d rotation = RotationFromVector({0, angle, 0});
    const Eigen::Vector3d target(0, 0, 12000);
    rig.push_back({camera, Rigid3{rotation, target - rotation * target}});
  }
  return rig;
}

struct Arrays {
  std::vector<std::int64_t> offsets{0};
  std::vector<std::int32_t> camera;
  std::vector<double> xy, cov;

  void Add(const Rig& rig, const Eigen::Vector3d& point) {
    for (std::size_t c = 0; c < rig.size(); ++c) {
      const Eigen::Vector2d pixel = *ProjectFromWorld(rig[c], point);
      camera.push_back(static_cast<std::int32_t>(c));
      xy.insert(xy.end(), {pixel.x(), pixel.y()});
      cov.insert(cov.end(), {4e-4, 0.0, 4e-4});
    }
    offsets.push_back(static_cast<std::int64_t>(camera.size()));
  }
  MatchArrays View() const { return {offsets, camera, xy.data(), cov.data()}; }
};

Rig Perturbed(const Rig& rig, const Eigen::VectorXd& by) {
  Rig moved = rig;
  for (std::size_t c = 0; c < rig.size(); ++c) {
    const auto part =
        by.segment<kNumCameraParameters>(static_cast<Eigen::Index>(c) * kNumCameraParameters);
    moved[c].camera.interior += part.head<kNumInterior>();
    moved[c].cam_from_world.rotation =
        RotationFromVector(part.segment<3>(kNumInterior)) * rig[c].cam_from_world.rotation;
    moved[c].cam_from_world.translation_mm += part.tail<3>();
  }
  return moved;
}

// A covariance as calibrations leave it: f and principal point correlated with the pose.
Eigen::MatrixXd CovarianceFactor() {
  Eigen::VectorXd sigma(32);
  for (int c = 0; c < 2; ++c) {
    sigma.segment<16>(16 * c) << 0.8, 1.4, 1.3, 1e-9, 0, 0, 1e-8, 1e-8, 1e-5, 1e-5, 3e-5, 3e-5,
        3e-5, 0.2, 0.3, 0.3;
  }
  Eigen::MatrixXd factor = sigma.asDiagonal();
  factor(10, 2) = 1e-4;
  factor(0, 15) = 0.5;
  return factor;
}

Rig RandomRig(const Rig& rig, const Eigen::MatrixXd& factor, std::mt19937* random) {
  std::normal_distribution<double> normal;
  Eigen::VectorXd draw(factor.cols());
  for (double& value : draw) value = normal(*random);
  return Perturbed(rig, factor * draw);
}

// Cameras drawn from their covariance scatter the point as cov_rig says: the
// normalised squared error's mean over m trials is 3 +- sqrt(6/m).
TEST(Triangulate, CalibrationPartIsTheScatterOverRigs) {
  const Rig rig = Pair();
  const Eigen::MatrixXd factor = CovarianceFactor();
  const Eigen::Vector3d point(400, -700, 12300);
  Arrays arrays;
  arrays.Add(rig, point);
  const TriangulatedPoints truth =
      Triangulate(rig, arrays.View(), {factor * factor.transpose(), {}});
  const Eigen::Matrix3d predicted = Eigen::Map<const Eigen::Matrix3d>(truth.cov_rig.data());

  constexpr int kTrials = 3000;
  for (const unsigned seed : {5U, 6U}) {
    std::mt19937 random(seed);
    double error = 0;
    for (int i = 0; i < kTrials; ++i) {
      const TriangulatedPoints moved = Triangulate(RandomRig(rig, factor, &random), arrays.View());
      const Eigen::Vector3d d = Eigen::Map<const Eigen::Vector3d>(moved.position_mm.data()) - point;
      error += d.dot(predicted.inverse() * d) / kTrials;
    }
    EXPECT_NEAR(error, 3.0, 4 * std::sqrt(6.0 / kTrials)) << "seed " << seed;
  }
}

// With the frame's shared motion taken out, the predicted covariance is that of
// what remains after a best fit of rotation and translation to the true points.
TEST(Triangulate, FrameFreePartIsTheScatterAfterBestFit) {
  const Rig rig = Pair();
  const Eigen::MatrixXd factor = CovarianceFactor();
  Arrays arrays;
  std::mt19937 place(9);
  std::uniform_real_distribution<double> across(-1500, 1500);
  constexpr int kPoints = 30;
  Eigen::Matrix<double, kPoints, 3> points;
  for (int i = 0; i < kPoints; ++i) {
    points.row(i) << across(place), across(place), 12000 + across(place);
    arrays.Add(rig, points.row(i).transpose());
  }
  const RigCovariance covariance = {factor * factor.transpose(),
                                    SharedFrameMotion(rig, arrays.View())};
  const TriangulatedPoints free = Triangulate(rig, arrays.View(), covariance);
  const TriangulatedPoints fixed = Triangulate(rig, arrays.View(), {covariance.parameters, {}});

  constexpr int kTrials = 2000;
  std::mt19937 random(7);
  Eigen::VectorXd scatter = Eigen::VectorXd::Zero(3 * kPoints);
  for (int t = 0; t < kTrials; ++t) {
    const TriangulatedPoints moved = Triangulate(RandomRig(rig, factor, &random), arrays.View());
    const Eigen::Map<const Eigen::Matrix<double, kPoints, 3, Eigen::RowMajor>> found(
        moved.position_mm.data());
    const Rigid3 back = FitRigid3(points, found);
    for (int i = 0; i < kPoints; ++i) {
      const Eigen::Vector3d d = back * found.row(i).transpose() - points.row(i).transpose();
      scatter.segment<3>(3 * i) += d.cwiseAbs2() / kTrials;
    }
  }
  double trace_free = 0, trace_fixed = 0;
  for (int i = 0; i < kPoints; ++i) {
    for (int k = 0; k < 3; ++k) {
      const auto at = static_cast<std::size_t>(9 * i + 4 * k);
      // A variance from m trials scatters by sqrt(2/m) of itself.
      EXPECT_NEAR(scatter[3 * i + k] / free.cov_rig[at], 1.0, 5 * std::sqrt(2.0 / kTrials))
          << "point " << i << ", axis " << k;
      trace_free += free.cov_rig[at];
      trace_fixed += fixed.cov_rig[at];
    }
  }
  EXPECT_LT(trace_free, trace_fixed);
  Arrays two;
  two.Add(rig, {0, 0, 12000});
  two.Add(rig, {100, 0, 12000});
  EXPECT_THROW(SharedFrameMotion(rig, two.View()), std::invalid_argument);
}

TEST(Triangulate, ThreadsChangeNothingAndOneFailureHarmsNoOther) {
  const Rig rig = Pair();
  Arrays arrays;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> across(-1500, 1500);
  for (int i = 0; i < 200; ++i) arrays.Add(rig, {across(random), across(random), 12000});
  arrays.camera.push_back(0);  // a point seen once
  arrays.xy.insert(arrays.xy.end(), {500.0, 500.0});
  arrays.cov.insert(arrays.cov.end(), {1e-4, 0.0, 1e-4});
  arrays.offsets.push_back(static_cast<std::int64_t>(arrays.camera.size()));

  const TriangulatedPoints one = Triangulate(rig, arrays.View(), {}, {1});
  const TriangulatedPoints many = Triangulate(rig, arrays.View(), {}, {3});
  EXPECT_EQ(one.status[200], static_cast<std::uint8_t>(IntersectionStatus::kTooFewRays));
  EXPECT_TRUE(std::isnan(one.position_mm[600]));
  for (std::size_t i = 0; i < 600; ++i) ASSERT_EQ(one.position_mm[i], many.position_mm[i]);
  for (std::size_t i = 0; i < 200; ++i) ASSERT_EQ(one.status[i], 0);
}

// G C G^T of the derivatives is the covariance that Triangulate states, in either frame.
TEST(PointDerivatives, GiveTheCovarianceOfTriangulate) {
  const Rig rig = Pair();
  Arrays arrays;
  const std::vector<double> points = {0,     0,   12000, 900,  -700, 11500,
                                      -1200, 300, 12600, -500, 1100, 12200};
  for (std::size_t i = 0; i < points.size(); i += 3) {
    arrays.Add(rig, {points[i], points[i + 1], points[i + 2]});
  }
  const Eigen::MatrixXd factor = CovarianceFactor();
  const Eigen::MatrixXd covariance = factor * factor.transpose();
  const MatchArrays bare = {arrays.offsets, arrays.camera, nullptr, arrays.cov.data()};
  for (const bool in_volume : {false, true}) {
    const Eigen::MatrixXd frame =
        in_volume ? SharedFrameMotion(rig, arrays.View()) : Eigen::MatrixXd();
    const TriangulatedPoints found = Triangulate(rig, arrays.View(), {covariance, frame});
    const std::vector<double> derivatives = PointDerivatives(rig, bare, points, frame);
    ASSERT_EQ(derivatives.size(), 4U * 3 * 32);
    for (std::size_t i = 0; i < 4; ++i) {
      using RowMatrix = Eigen::Matrix<double, 3, 32, Eigen::RowMajor>;
      const Eigen::Map<const RowMatrix> g(&derivatives[96 * i]);
      const Eigen::Matrix3d part = g * covariance * g.transpose();
      const Eigen::Map<const Eigen::Matrix3d> expected(&found.cov_rig[9 * i]);
      // Points found from their exact pictures to 1e-6 mm of 12 m.
      EXPECT_LT((part - expected).norm(), 1e-7 * expected.norm()) << "point " << i;
    }
  }
}

TEST(PointDerivatives, OfWhatIsNotDeterminedAreNan) {
  const Rig rig = Pair();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Arrays arrays;
  arrays.Add(rig, {0, 0, 12000});
  arrays.Add(rig, {0, 0, 12000});
  const std::vector<double> points = {nan, 0, 12000, 0, 0, -12000};
  for (const double value : PointDerivatives(rig, arrays.View(), points, {})) {
    ASSERT_TRUE(std::isnan(value));
  }
  EXPECT_THROW(PointDerivatives(rig, arrays.View(), {points.data(), 3}, {}), std::invalid_argument);
  EXPECT_THROW(PointDerivatives(rig, arrays.View(), points, Eigen::MatrixXd::Zero(6, 5)),
               std::invalid_argument);
}

TEST(Triangulate, RefusesInconsistentArrays) {
  const Rig rig = Pair();
  Arrays arrays;
  arrays.Add(rig, {0, 0, 12000});
  Arrays bad = arrays;
  bad.camera[0] = 7;
  EXPECT_THROW(Triangulate(rig, bad.View()), std::invalid_argument);
  bad = arrays;
  bad.offsets.back() = 9;
  EXPECT_THROW(Triangulate(rig, bad.View()), std::invalid_argument);
  EXPECT_THROW(Triangulate(rig, arrays.View(), {Eigen::MatrixXd::Identity(5, 5), {}}),
               std::invalid_argument);
}

/// A circle before `Pair`, its ellipses' centres and shapes as both cameras see them.
struct CircleScene {
  Rig rig = Pair();
  Arrays arrays;
  Eigen::Vector3d center{300, -200, 12000};
  Eigen::Vector3d normal;
  double diameter = 0;
  std::vector<double> ellipse, ellipse_cov;

  CircleScene(double diameter_mm, double tilt, double azimuth) : diameter(diameter_mm) {
    for (OrientedCamera& c : rig) c.camera.interior.tail<7>().setZero();
    normal = {std::sin(tilt) * std::cos(azimuth), std::sin(tilt) * std::sin(azimuth),
              -std::cos(tilt)};
    for (int c = 0; c < 2; ++c) {
      const OrientedCamera& camera = rig[static_cast<std::size_t>(c)];
      const Circle in_cam{camera.cam_from_world * center, camera.cam_from_world.rotation * normal,
                          0.5 * diameter};
      const Eigen::Vector2d pixel = *ProjectEllipseCenter(camera.camera, in_cam);
      const Eigen::Vector3d s = *ProjectedShape(in_cam) * std::pow(camera.camera.f_px(), 2);
      // The ellipse of the shape S: its conic's upper-left block is S^-1.
      Eigen::Matrix3d conic = Eigen::Vector3d(0, 0, -1).asDiagonal();
      conic.topLeftCorner<2, 2>() =
          (Eigen::Matrix2d() << s[0], s[1], s[1], s[2]).finished().inverse();
      const Ellipse e = *EllipseFromConic(conic);
      arrays.camera.push_back(c);
      arrays.xy.insert(arrays.xy.end(), {pixel.x(), pixel.y()});
      arrays.cov.insert(arrays.cov.end(), {2.5e-5, 0.0, 2.5e-5});
      ellipse.insert(ellipse.end(), {e.semi_major_px, e.semi_minor_px, e.angle_rad});
      const double turn = 0.01 * e.semi_major_px /
                          (std::pow(e.semi_major_px, 2) - std::pow(e.semi_minor_px, 2) + 1e-3);
      ellipse_cov.insert(ellipse_cov.end(), {1e-4, 0, 0, 0, 1e-4, 0, 0, 0, turn * turn});
    }
    arrays.offsets.push_back(2);
  }

  CircleArrays Measured() const {
    CircleArrays circles;
    circles.diameter_mm = &diameter;
    circles.ellipse = ellipse.data();
    circles.ellipse_cov = ellipse_cov.data();
    return circles;
  }
  void AddNoise(std::mt19937* random) {
    std::normal_distribution<double> unit;
    for (double& x : arrays.xy) x += 0.005 * unit(*random);
    for (std::size_t k = 0; k < ellipse.size(); ++k) {
      ellipse[k] += std::sqrt(ellipse_cov[9 * (k / 3) + 4 * (k % 3)]) * unit(*random);
    }
  }
};

Eigen::Vector3d PositionOf(const TriangulatedPoints& points) {
  return Eigen::Map<const Eigen::Vector3d>(points.position_mm.data());
}

TEST(TriangulateCircles, TheCentreComesBack) {
  for (const double tilt : {0.0, 0.4, 0.9}) {
    const CircleScene scene(140, tilt, 0.6);
    const auto plain = Triangulate(scene.rig, scene.arrays.View());
    const auto with = Triangulate(scene.rig, scene.arrays.View(), {}, {}, scene.Measured());
    ASSERT_EQ(with.status[0], 0) << tilt;
    EXPECT_EQ(with.circle[0], static_cast<int>(CircleStatus::kEstimated));
    // A normal right to 1e-4 rad leaves 1e-4 of an offset of 0.09 px, 4.5 mm a pixel and
    // twice that in depth.
    EXPECT_LT((PositionOf(with) - scene.center).norm(), 1e-3) << tilt;
    if (tilt > 0) {
      EXPECT_GT((PositionOf(plain) - scene.center).norm(), 0.05) << tilt;
    }
    CircleArrays known = scene.Measured();
    known.ellipse = nullptr;
    known.normal = scene.normal.data();
    const auto given = Triangulate(scene.rig, scene.arrays.View(), {}, {}, known);
    EXPECT_EQ(given.circle[0], static_cast<int>(CircleStatus::kKnown));
    EXPECT_LT((PositionOf(given) - scene.center).norm(), 1e-6) << tilt;
  }
}

TEST(TriangulateCircles, ThicknessMovesAlongTheNormal) {
  CircleScene scene(140, 0.5, 0.6);
  CircleArrays circles = scene.Measured();
  circles.thickness_mm = 2;
  const auto moved = Triangulate(scene.rig, scene.arrays.View(), {}, {}, circles);
  EXPECT_LT((PositionOf(moved) - (scene.center - 2 * scene.normal)).norm(), 2e-3);
  // A normal given from behind is turned round.
  const Eigen::Vector3d behind = -scene.normal;
  circles.normal = behind.data();
  const auto turned = Triangulate(scene.rig, scene.arrays.View(), {}, {}, circles);
  EXPECT_LT((PositionOf(turned) - (scene.center - 2 * scene.normal)).norm(), 1e-6);
  // Nothing that says a normal: with a thickness the point is refused, without it stays.
  circles.normal = circles.ellipse = nullptr;
  EXPECT_EQ(Triangulate(scene.rig, scene.arrays.View(), {}, {}, circles).status[0],
            static_cast<int>(IntersectionStatus::kNoNormal));
  circles.thickness_mm = 0;
  const auto left = Triangulate(scene.rig, scene.arrays.View(), {}, {}, circles);
  EXPECT_EQ(left.status[0], 0);
  EXPECT_EQ(left.circle[0], static_cast<int>(CircleStatus::kNoNormal));
}

// Normalised errors of N draws, three degrees of freedom: mean 3, its deviation
// sqrt(6 / N); 10 % for the normal's covariance, which is of first order. Thickness 30:
// the normal's part is then as large as the noise's.
TEST(TriangulateCircles, CovarianceHoldsByMonteCarlo) {
  constexpr int kDraws = 1500;
  for (const double tilt : {0.3, 0.9}) {
    for (const double thickness : {0.0, 30.0}) {
      std::mt19937 random(3);
      double sum = 0, chi2 = 0;
      for (int i = 0; i < kDraws; ++i) {
        CircleScene scene(140, tilt, 0.6);
        scene.AddNoise(&random);
        CircleArrays circles = scene.Measured();
        circles.thickness_mm = thickness;
        const auto points = Triangulate(scene.rig, scene.arrays.View(), {}, {}, circles);
        ASSERT_EQ(points.status[0], 0) << "seed 3, draw " << i;
        const Eigen::Vector3d off = PositionOf(points) - (scene.center - thickness * scene.normal);
        const Eigen::Map<const Eigen::Matrix3d> cov(points.cov_image.data());
        sum += off.dot(cov.inverse() * off);
        chi2 += points.chi2[0];
      }
      // The shapes' chi2, 3 degrees of freedom, enlarges every second covariance a little:
      // E[1 / max(1, chi2 / 3)] = 0.82 of the normal's part where it is all.
      EXPECT_LT(sum / kDraws, 3 + 5 * std::sqrt(6.0 / kDraws) + 0.3) << tilt << " " << thickness;
      EXPECT_GT(sum / kDraws, 3 * 0.75 - 5 * std::sqrt(6.0 / kDraws)) << tilt << " " << thickness;
      EXPECT_NEAR(chi2 / kDraws, 1, 5 * std::sqrt(2.0 / kDraws)) << tilt << " " << thickness;
    }
  }
}

TEST(TriangulateCircles, BadInputIsNamed) {
  CircleScene scene(140, 0.5, 0.6);
  for (const double diameter : {-1.0, 0.0, std::numeric_limits<double>::infinity()}) {
    scene.diameter = diameter;
    EXPECT_THROW(Triangulate(scene.rig, scene.arrays.View(), {}, {}, scene.Measured()),
                 std::invalid_argument);
  }
  scene.diameter = 140;
  CircleArrays circles = scene.Measured();
  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
  circles.normal = zero.data();
  EXPECT_THROW(Triangulate(scene.rig, scene.arrays.View(), {}, {}, circles), std::invalid_argument);
  circles = scene.Measured();
  circles.thickness_mm = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(Triangulate(scene.rig, scene.arrays.View(), {}, {}, circles), std::invalid_argument);
}

}  // namespace
}  // namespace videogrammetry
