#include "videogrammetry/adjustment/gauss_newton.h"

#include <gtest/gtest.h>

#include "synthetic.h"
#include "videogrammetry/adjustment/ceres_bundle.h"
#include "videogrammetry/adjustment/dispersion.h"
#include "videogrammetry/adjustment/normal_equations.h"
#include "videogrammetry/adjustment/observation_model.h"

// Two minimisers of the same sum of squares, on linearisations of their own, must agree.
namespace videogrammetry {
namespace {

enum class Kind { kRig, kCorrected, kWindow, kFreeWithBars, kManyPictures, kPriorBlock };

std::string NameOf(const testing::TestParamInfo<Kind>& kind) {
  static constexpr std::array<const char*, 6> kNames = {
      "Rig", "Corrected", "Window", "FreeWithBars", "ManyPictures", "PriorBlock"};
  return kNames.at(static_cast<std::size_t>(kind.param));
}

void AddWindow(Network* n) {
  NetworkInterface window;
  window.name = "window";
  window.nominal.normal = Eigen::Vector3d(0.05, -0.03, -1).normalized();
  window.nominal.distance_mm = -2300;
  window.nominal.glass_index = 1.5;
  window.nominal.glass_thickness_mm = 10;
  window.distance_mm = window.nominal.distance_mm;
  window.free.fill(true);
  window.prior_sigma << 0.01, 0.0, 5.0;
  n->interfaces.push_back(window);
  for (NetworkCamera& c : n->cameras) c.interface = 0;
}

/// Noisy pictures of a rig, an observed focal length, rows that are no squares.
Network MakeNetwork(Kind kind, std::mt19937* random) {
  synthetic::Options options;
  if (kind == Kind::kManyPictures) {  // points stay, poses are eliminated
    options.num_cameras = 2;
    options.num_stages = 30;
    options.num_points = 12;
  }
  Network n = synthetic::MakeRig(random, options);
  n.cameras[1].aspect = 0.02;
  n.cameras[0].prior_sigma[kF] = 1.0;
  if (kind == Kind::kCorrected) {
    for (NetworkCamera& c : n.cameras) {
      c.camera.direction = DistortionDirection::kMeasured;
      c.corrected_residual = true;
    }
    n.cameras[1].free[kAspect] = true;
  }
  if (kind == Kind::kWindow) AddWindow(&n);
  if (kind == Kind::kFreeWithBars) {
    n.datum = Datum::kFree;
    for (NetworkPoint& p : n.points) p.kind = PointKind::kFree;
    for (int b = 0; b < 3; ++b) {
      const Eigen::Vector3d along = n.points[2 * b].position_mm - n.points[2 * b + 1].position_mm;
      n.scale_bars.push_back({2 * b, 2 * b + 1, along.norm() + 0.01 * b, 0.01});
    }
  }
  std::vector<NetworkObservation> seen;
  for (NetworkObservation& o : n.observations) {
    const auto pixel = PredictImagePoint(n, o.image, o.point, o.velocity_px);
    if (!pixel) continue;
    o.xy_px = *pixel;
    seen.push_back(o);
  }
  n.observations = seen;
  synthetic::AddNoise(random, &n);
  if (kind == Kind::kPriorBlock) {
    Eigen::VectorXd mean(3 * 5);
    for (int i = 0; i < 5; ++i) mean.segment<3>(3 * i) = n.points[i].prior_mm;
    const Eigen::MatrixXd mixed =
        Eigen::MatrixXd::Identity(15, 15) + 0.5 * Eigen::MatrixXd::Ones(15, 15);
    n.SetPriorBlock({0, 1, 2, 3, 4}, mean, 0.01 * mixed);
  }
  return n;
}

class GaussNewton : public testing::TestWithParam<Kind> {};

// Both stop where v'Pv, some 700 with rounding of 1e-13, no longer falls: sqrt(7e-11) = 1e-5
// of a standard deviation from the minimum, in the worst direction. A derivative that missed
// one of the terms would show at once.
TEST_P(GaussNewton, FindsTheMinimumThatCeresFinds) {
  for (const double loss : {0.0, 3.0}) {
    for (const unsigned seed : {1U, 2U}) {
      std::mt19937 random(seed);
      Network ours = MakeNetwork(GetParam(), &random);
      if (loss > 0) ours.observations[7].xy_px.x() += 5.0;
      synthetic::Disturb(&random, 0.1, &ours);
      if (!ours.interfaces.empty()) ours.interfaces[0].set_values({0.005, -0.004, -2297});
      Network theirs = ours;
      BundleOptions options;
      options.cauchy_scale = loss;
      options.near_solution = false;
      options.function_tolerance = 1e-15;
      options.num_threads = 1;
      const auto summary = SolveNormalEquations(&ours, options);
      ASSERT_TRUE(summary) << "seed " << seed << ", loss " << loss;
      const BundleSummary ceres = SolveWithCeres(&theirs, options);
      EXPECT_NEAR(summary->final_cost / ceres.final_cost, 1.0, 1e-11);
      const Dispersion dispersion(ours);
      const UnknownIndex& index = dispersion.index();
      auto expect = [&](int unknown, double difference) {
        if (unknown < 0) return;
        const double sigma = std::sqrt(dispersion.Covariance({unknown}, {unknown})(0, 0));
        EXPECT_LT(std::abs(difference), 1e-4 * sigma)
            << UnknownName(ours, index, unknown) << ", seed " << seed << ", loss " << loss;
      };
      for (std::size_t c = 0; c < ours.cameras.size(); ++c) {
        const CameraVector change = ours.cameras[c].values() - theirs.cameras[c].values();
        for (int k = 0; k < kNumCameraUnknowns; ++k) expect(index.camera[c][k], change[k]);
      }
      for (std::size_t p = 0; p < ours.poses.size(); ++p) {
        if (index.pose[p] < 0) continue;
        const Rigid3 &a = ours.poses[p].transform, &b = theirs.poses[p].transform;
        const Eigen::Vector3d turn = VectorFromRotation(a.rotation * b.rotation.transpose());
        for (int k = 0; k < 3; ++k) {
          expect(index.pose[p] + k, turn[k]);
          expect(index.pose[p] + 3 + k, a.translation_mm[k] - b.translation_mm[k]);
        }
      }
      for (std::size_t i = 0; i < ours.interfaces.size(); ++i) {
        for (int k = 0; k < kNumInterfaceUnknowns; ++k) {
          expect(index.interface[i][k],
                 ours.interfaces[i].values()[k] - theirs.interfaces[i].values()[k]);
        }
      }
      for (std::size_t p = 0; p < ours.points.size(); ++p) {
        for (int k = 0; index.point[p] >= 0 && k < 3; ++k) {
          expect(index.point[p] + k,
                 ours.points[p].position_mm[k] - theirs.points[p].position_mm[k]);
        }
      }
    }
  }
}

// d(cost)/dx = -2 A'Pv, of the loss as well. The gradient's error by central differences of
// step h = 1e-3 sigma_x (of the unknown alone) is rounding of the cost over h.
TEST_P(GaussNewton, GradientIsThatOfTheCost) {
  for (const double loss : {0.0, 3.0}) {
    std::mt19937 random(5);
    Network n = MakeNetwork(GetParam(), &random);
    synthetic::Disturb(&random, 0.01, &n);
    const UnknownIndex index(n);
    const Elimination elimination(n, index);
    const NormalOptions options{loss, 0.0};
    const NormalEquations normal(n, index, elimination, options);
    ASSERT_EQ(normal.num_invalid, 0);
    for (int u = 0; u < index.num_unknowns; ++u) {
      const int block = elimination.block_of[u], place = elimination.place[u];
      const double own =
          block < 0 ? normal.diagonal[place] : normal.blocks[block].normal(place, place);
      const double h = 1e-2 / std::sqrt(own);
      auto cost = [&](double step) {
        Network moved = n;
        MoveUnknowns(index, step * h * Eigen::VectorXd::Unit(index.num_unknowns, u), &moved);
        return NormalEquations(moved, index, elimination, options).cost;
      };
      const double numerical = (8 * (cost(1) - cost(-1)) - (cost(2) - cost(-2))) / (12 * h);
      // In units of 1 / sigma_x the cost's second derivative is 2: 1e-6 of it, and rounding.
      EXPECT_NEAR(-2 * normal.gradient[u] / std::sqrt(own), numerical / std::sqrt(own),
                  1e-6 * std::sqrt(normal.cost) + 1e-12 * normal.cost / 1e-2)
          << UnknownName(n, index, u) << ", loss " << loss;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Networks, GaussNewton,
                         testing::Values(Kind::kRig, Kind::kCorrected, Kind::kWindow,
                                         Kind::kFreeWithBars, Kind::kManyPictures,
                                         Kind::kPriorBlock),
                         NameOf);

TEST(GaussNewton, LeavesAStartThatItCannotUseAsItWas) {
  std::mt19937 random(3);
  Network n = MakeNetwork(Kind::kRig, &random);
  n.poses.back().transform.translation_mm.z() = -3000;  // behind the cameras
  const Network before = n;
  EXPECT_FALSE(SolveNormalEquations(&n, {}));
  for (std::size_t p = 0; p < n.poses.size(); ++p) {
    EXPECT_EQ(n.poses[p].transform.translation_mm, before.poses[p].transform.translation_mm);
  }
}

// Points that one picture sees each: no step can be solved for, of which glog would tell.
TEST(SolveWithCeres, KeepsItsLogToItself) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    std::mt19937 random(seed);
    Network n = synthetic::MakeRig(&random, {});
    n.observations.resize(20);
    for (NetworkPoint& p : n.points) p.kind = PointKind::kFree;
    synthetic::Disturb(&random, 0.3, &n);
    testing::internal::CaptureStderr();
    SolveWithCeres(&n, {});
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "seed " << seed;
  }
}

}  // namespace
}  // namespace videogrammetry
