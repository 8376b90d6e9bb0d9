#include "videogrammetry/reconstruction/triangulate.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
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
    const auto part = by.segment<kNumCameraParameters>(static_cast<Eigen::Index>(c) *
                                                       kNumCameraParameters);
    moved[c].camera.interior += part.head<kNumInterior>();
    moved[c].cam_from_world.rotation =
        RotationFromVector(part.segment<3>(kNumInterior)) * rig[c].cam_from_world.rotation;
    moved[c].cam_from_world.translation_mm += part.tail<3>();
  }
  return moved;
}

// Cameras drawn from their covariance scatter the point as cov_rig says: the
// normalised squared error's mean over m trials is 3 +- sqrt(6/m).
TEST(Triangulate, CalibrationPartIsTheScatterOverRigs) {
  const Rig rig = Pair();
  Eigen::VectorXd sigma(32);
  for (int c = 0; c < 2; ++c) {
    sigma.segment<16>(16 * c) << 0.8, 1.4, 1.3, 1e-9, 0, 0, 1e-8, 1e-8, 1e-5, 1e-5, 3e-5, 3e-5,
        3e-5, 0.2, 0.3, 0.3;
  }
  // f and principal point correlated with the pose, as calibrations leave them.
  Eigen::MatrixXd factor = sigma.asDiagonal();
  factor(10, 2) = 1e-4;
  factor(0, 15) = 0.5;
  const Eigen::MatrixXd cov = factor * factor.transpose();

  const Eigen::Vector3d point(400, -700, 12300);
  Arrays arrays;
  arrays.Add(rig, point);
  const TriangulatedPoints truth = Triangulate(rig, arrays.View(), cov);
  const Eigen::Matrix3d predicted = Eigen::Map<const Eigen::Matrix3d>(truth.cov_rig.data());

  constexpr int kTrials = 3000;
  for (const unsigned seed : {5U, 6U}) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    double error = 0;
    for (int i = 0; i < kTrials; ++i) {
      Eigen::VectorXd draw(32);
      for (double& value : draw) value = normal(random);
      const TriangulatedPoints moved =
          Triangulate(Perturbed(rig, factor * draw), arrays.View(), Eigen::MatrixXd());
      const Eigen::Vector3d d =
          Eigen::Map<const Eigen::Vector3d>(moved.position_mm.data()) - point;
      error += d.dot(predicted.inverse() * d) / kTrials;
    }
    EXPECT_NEAR(error, 3.0, 4 * std::sqrt(6.0 / kTrials)) << "seed " << seed;
  }
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

  const TriangulatedPoints one = Triangulate(rig, arrays.View(), Eigen::MatrixXd(), {1});
  const TriangulatedPoints many = Triangulate(rig, arrays.View(), Eigen::MatrixXd(), {3});
  EXPECT_EQ(one.status[200], static_cast<std::uint8_t>(IntersectionStatus::kTooFewRays));
  EXPECT_TRUE(std::isnan(one.position_mm[600]));
  for (std::size_t i = 0; i < 600; ++i) ASSERT_EQ(one.position_mm[i], many.position_mm[i]);
  for (std::size_t i = 0; i < 200; ++i) ASSERT_EQ(one.status[i], 0);
}

TEST(Triangulate, RefusesInconsistentArrays) {
  const Rig rig = Pair();
  Arrays arrays;
  arrays.Add(rig, {0, 0, 12000});
  Arrays bad = arrays;
  bad.camera[0] = 7;
  EXPECT_THROW(Triangulate(rig, bad.View(), Eigen::MatrixXd()), std::invalid_argument);
  bad = arrays;
  bad.offsets.back() = 9;
  EXPECT_THROW(Triangulate(rig, bad.View(), Eigen::MatrixXd()), std::invalid_argument);
  EXPECT_THROW(Triangulate(rig, arrays.View(), Eigen::MatrixXd::Identity(5, 5)),
               std::invalid_argument);
}

}  // namespace
}  // namespace videogrammetry
