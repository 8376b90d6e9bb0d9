#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "synthetic.h"
#include "videogrammetry/adjustment/bundle.h"
#include "videogrammetry/adjustment/dispersion.h"
#include "videogrammetry/adjustment/normal_equations.h"
#include "videogrammetry/adjustment/observation_model.h"

// A window into a fluid as a part of the network.
namespace videogrammetry {
namespace {

/// The rig of synthetic.h looking at the target through a tilted pane 700 mm before it.
Network MakeTank(std::mt19937* random, const synthetic::Options& options) {
  Network n = synthetic::MakeRig(random, options);
  NetworkInterface window;
  window.name = "window";
  window.nominal.normal = Eigen::Vector3d(0.05, -0.03, -1).normalized();
  window.nominal.distance_mm = -2300;
  window.nominal.glass_index = 1.5;
  window.nominal.glass_thickness_mm = 10;
  window.distance_mm = window.nominal.distance_mm;
  window.free.fill(true);
  n.interfaces.push_back(window);
  for (NetworkCamera& c : n.cameras) c.interface = 0;
  std::vector<NetworkObservation> seen;
  for (NetworkObservation& o : n.observations) {
    const auto pixel = PredictImagePoint(n, o.image, o.point, o.velocity_px);
    if (!pixel) continue;
    o.xy_px = *pixel;
    seen.push_back(o);
  }
  n.observations = seen;
  return n;
}

// Central differences with Richardson's step, as in jacobian_test.cc.
template <typename Change>
Eigen::Vector2d Numerical(const Change& change, double h) {
  const Eigen::Vector2d d1 = (change(h) - change(-h)) / (2 * h);
  const Eigen::Vector2d d2 = (change(2 * h) - change(-2 * h)) / (4 * h);
  return (4 * d1 - d2) / 3;
}

TEST(Interface, JacobiansEqualDifferences) {
  std::mt19937 random(3);
  Network n = MakeTank(&random, {});
  n.cameras[1].aspect = 0.02;  // rows shrink all derivatives alike
  NetworkInterface& window = n.interfaces[0];
  window.tilt = {0.02, -0.03};
  // Both ways of an image: with an outer pose, and with one of its own, where
  // the object's frame is the rig's: image 1 is of camera 1.
  NetworkImage own = n.images[1];
  own.outer = -1;
  n.poses.push_back({"own", n.poses[1].transform, true});
  own.inner = static_cast<int>(n.poses.size()) - 1;
  n.images.push_back(own);
  const int last = static_cast<int>(n.images.size()) - 1;
  for (NetworkPoint& p : n.points) p.position_mm.z() += 0.1;
  n.points[7].position_mm = {30, -50, 3000};
  for (const auto& [image, point] : {std::pair(1, 5), std::pair(last, 7)}) {
    auto at = [&](auto change) {
      return [&n, image, point, change](double h) {
        Network t = n;
        change(&t, h);
        return *PredictImagePoint(t, image, point, {});
      };
    };
    const UnknownIndex index(n);
    const ImageRow row = LineariseImagePoint(n, index, image, point, {});
    ASSERT_TRUE(row.valid);
    auto column = [&](int unknown) -> Eigen::Vector2d {
      for (int i = 0; i < row.size; ++i) {
        if (row.unknown[i] == unknown) return row.design.col(i);
      }
      ADD_FAILURE() << "unknown " << unknown << " is not met";
      return Eigen::Vector2d::Zero();
    };
    auto expect = [&](int unknown, const Eigen::Vector2d& numerical) {
      EXPECT_LT((column(unknown) - numerical).norm(), 1e-6 * (numerical.norm() + 1e-3))
          << UnknownName(n, index, unknown) << " of image " << image;
    };
    for (int k = 0; k < kNumInterfaceUnknowns; ++k) {
      auto change = [k](Network* t, double h) {
        Eigen::Vector3d values = t->interfaces[0].values();
        values[k] += h;
        t->interfaces[0].set_values(values);
      };
      expect(index.interface[0][k], Numerical(at(change), k < 2 ? 1e-3 : 1.0));
    }
    const NetworkImage& picture = n.images[image];
    for (const int pose : {picture.outer, picture.inner}) {
      for (int k = 0; pose >= 0 && k < 6; ++k) {
        auto change = [k, pose](Network* t, double h) {
          Rigid3& moved = t->poses[pose].transform;
          if (k < 3) {
            moved.rotation = RotationFromVector(h * Eigen::Vector3d::Unit(k)) * moved.rotation;
          } else {
            moved.translation_mm[k - 3] += h;
          }
        };
        expect(index.pose[pose] + k, Numerical(at(change), k < 3 ? 1e-3 : 1.0));
      }
    }
    for (int k = 0; k < 3; ++k) {
      auto change = [k, point](Network* t, double h) { t->points[point].position_mm[k] += h; };
      expect(index.point[point] + k, Numerical(at(change), 1.0));
    }
  }
}

TEST(Interface, FoundFromADistance) {
  std::mt19937 random(4);
  Network n = MakeTank(&random, {});
  const Network truth = n;
  synthetic::Disturb(&random, 0.3, &n);
  n.interfaces[0].set_values({0.03, -0.02, -2270});
  BundleOptions options;
  options.near_solution = false;
  const BundleSummary summary = SolveBundle(&n, options);
  EXPECT_TRUE(summary.converged);
  EXPECT_LT(summary.final_cost, 1e-9);
  EXPECT_LT(n.interfaces[0].tilt.norm(), 1e-6);
  EXPECT_NEAR(n.interfaces[0].distance_mm, -2300, 1e-3);
}

// As in dispersion_test.cc: the mean of chi-square with U degrees of freedom over N draws.
TEST(Interface, CovarianceAgreesWithMonteCarlo) {
  constexpr int kDraws = 60;
  std::mt19937 random(12);
  synthetic::Options options;
  options.num_stages = 5;
  options.num_points = 20;
  Network truth = MakeTank(&random, options);
  for (const double prior_mm : {0.0, 0.5}) {
    truth.interfaces[0].prior_sigma[kDistance] = prior_mm;
    double sum = 0.0;
    for (int draw = 0; draw < kDraws; ++draw) {
      Network network = truth;
      synthetic::AddNoise(&random, &network);
      network.interfaces[0].nominal.distance_mm += synthetic::Normal(&random, prior_mm);
      ASSERT_TRUE(SolveBundle(&network, {}).converged);
      const Dispersion dispersion(network);
      const auto& place = dispersion.index().interface[0];
      const std::vector<int> unknowns(place.begin(), place.end());
      const Eigen::Matrix3d cov = dispersion.Covariance(unknowns, unknowns);
      const Eigen::Vector3d scale = cov.diagonal().cwiseSqrt().cwiseInverse();
      const Eigen::Vector3d error =
          scale.cwiseProduct(network.interfaces[0].values() - truth.interfaces[0].values());
      const Eigen::Matrix3d correlation = scale.asDiagonal() * cov * scale.asDiagonal();
      sum += error.dot(correlation.llt().solve(error));
      if (prior_mm > 0) {
        EXPECT_LT(std::sqrt(cov(2, 2)), prior_mm);
      }
    }
    EXPECT_NEAR(sum / kDraws, 3, 4 * std::sqrt(2.0 * 3 / kDraws)) << prior_mm;
  }
}

TEST(Interface, HeldOnesStay) {
  std::mt19937 random(5);
  Network n = MakeTank(&random, {});
  synthetic::AddNoise(&random, &n);
  n.interfaces[0].free = {false, true, false};
  ASSERT_TRUE(SolveBundle(&n, {}).converged);
  EXPECT_EQ(n.interfaces[0].tilt[0], 0);
  EXPECT_NE(n.interfaces[0].tilt[1], 0);
  EXPECT_EQ(n.interfaces[0].distance_mm, -2300);
  const Dispersion dispersion(n);
  const UnknownIndex& index = dispersion.index();
  EXPECT_EQ(index.interface[0][0], -1);
  EXPECT_EQ(UnknownName(n, index, index.interface[0][1]), "window tilt_2");
  EXPECT_EQ(index.interface[0][1], index.num_orientation - 1);
}

TEST(Interface, WhatCannotBeIsRefused) {
  std::mt19937 random(6);
  const Network n = MakeTank(&random, {});
  Network wrong = n;
  wrong.cameras[0].interface = 1;
  EXPECT_THROW(wrong.Check(), std::invalid_argument);
  wrong = n;
  wrong.interfaces[0].nominal.fluid_index = 0.9;
  EXPECT_THROW(wrong.Check(), std::invalid_argument);
  wrong = n;
  wrong.datum = Datum::kFree;
  EXPECT_THROW(wrong.Check(), std::invalid_argument);
}

}  // namespace
}  // namespace videogrammetry
