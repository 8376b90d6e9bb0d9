#include "videogrammetry/adjustment/dispersion.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <numeric>

#include "synthetic.h"
#include "videogrammetry/adjustment/bundle.h"
#include "videogrammetry/adjustment/significance.h"
#include "videogrammetry/core/errors.h"

namespace videogrammetry {
namespace {

// Normalised squared error (x - truth)' Q^-1 (x - truth) is chi-square with U
// degrees of freedom: its mean over N draws lies within 4 sqrt(2 U / N) of U
// in all but 6e-5 of the cases, if the covariance is right.
TEST(Dispersion, CovarianceAgreesWithMonteCarlo) {
  constexpr int kDraws = 60;
  std::mt19937 random(11);
  synthetic::Options options;
  options.num_stages = 5;
  options.num_points = 20;
  const Network truth = synthetic::MakeRig(&random, options);
  double sum = 0.0;
  int unknowns = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    Network network = truth;
    synthetic::AddNoise(&random, &network);
    ASSERT_TRUE(SolveBundle(&network, {}).converged);
    const Dispersion dispersion(network);
    const UnknownIndex& index = dispersion.index();
    unknowns = index.num_orientation;
    Eigen::VectorXd error(unknowns), scale(unknowns);
    for (std::size_t c = 0; c < truth.cameras.size(); ++c) {
      for (int k = 0; k < kNumInterior; ++k) {
        if (index.camera[c][k] < 0) continue;
        error[index.camera[c][k]] =
            network.cameras[c].camera.interior[k] - truth.cameras[c].camera.interior[k];
      }
    }
    for (std::size_t p = 0; p < truth.poses.size(); ++p) {
      if (index.pose[p] < 0) continue;
      const Rigid3 &a = network.poses[p].transform, &b = truth.poses[p].transform;
      error.segment<3>(index.pose[p]) = VectorFromRotation(a.rotation * b.rotation.transpose());
      error.segment<3>(index.pose[p] + 3) = a.translation_mm - b.translation_mm;
    }
    scale = dispersion.CovOrientation().diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd correlation =
        scale.asDiagonal() * dispersion.CovOrientation() * scale.asDiagonal();
    const Eigen::VectorXd e = scale.cwiseProduct(error);
    sum += e.dot(correlation.llt().solve(e));
  }
  EXPECT_GT(unknowns, 40);
  EXPECT_NEAR(sum / kDraws, unknowns, 4 * std::sqrt(2.0 * unknowns / kDraws));
}

// The block-wise covariance (points eliminated) against the plain inverse of
// the whole normal matrix built from numerical differences of the predictions.
TEST(Dispersion, FullCovarianceIsTheInverseOfTheNormalMatrix) {
  std::mt19937 random(12);
  synthetic::Options options;
  options.num_stages = 3;
  options.num_points = 12;
  Network network = synthetic::MakeRig(&random, options);
  const Dispersion dispersion(network);
  const Eigen::MatrixXd full = dispersion.FullCovariance();
  const int u = dispersion.index().num_orientation;
  ASSERT_EQ(full.rows(), u + 3 * options.num_points);
  EXPECT_LT((full - full.transpose()).norm(), 1e-9 * full.norm());
  for (int p = 0; p < options.num_points; ++p) {
    const Eigen::Matrix3d block = full.block<3, 3>(u + 3 * p, u + 3 * p);
    EXPECT_LT((block - dispersion.CovPoint(p)).norm(), 1e-9 * block.norm());
    // Observing a point can only sharpen what was known of it.
    EXPECT_GT((network.points[p].prior_cov_mm2 - block).eigenvalues().real().minCoeff(), -1e-12);
  }
}

// The redundancy numbers of all observations add up to the redundancy.
TEST(Dispersion, RedundancyNumbersAddUp) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    std::mt19937 random(seed);
    Network network = synthetic::MakeRig(&random, {});
    synthetic::AddNoise(&random, &network);
    SolveBundle(&network, {});
    const Dispersion dispersion(network);
    double sum = 0.0;
    for (const PointStatistics& s : dispersion.StatisticsOfPoints()) sum += s.redundancy;
    for (const ObservationStatistics& s : dispersion.Statistics()) sum += s.redundancy.sum();
    EXPECT_NEAR(sum, dispersion.redundancy(), 1e-5 * dispersion.redundancy()) << "seed " << seed;
    // v'Pv / redundancy scatters by sqrt(2 / r): four times that.
    const double s2 = dispersion.weighted_squares() / dispersion.redundancy();
    EXPECT_NEAR(s2, 1.0, 4 * std::sqrt(2.0 / dispersion.redundancy())) << "seed " << seed;
  }
}

// w is standard normal: mean square 1 within 4 sqrt(2 / r).
TEST(Dispersion, NormalisedResidualsAreStandardNormal) {
  std::mt19937 random(21);
  Network network = synthetic::MakeRig(&random, {});
  synthetic::AddNoise(&random, &network);
  SolveBundle(&network, {});
  double squares = 0.0;
  int count = 0;
  for (const ObservationStatistics& s : Dispersion(network).Statistics()) {
    squares += s.normalised.squaredNorm();
    count += 2;
  }
  EXPECT_NEAR(squares / count, 1.0, 4 * std::sqrt(2.0 / count));
}

TEST(Dispersion, NamesWhatARankDefectLeavesFree) {
  std::mt19937 random(13);
  Network network = synthetic::MakeRig(&random, {});
  network.poses[0].free = true;  // no datum for the rig's frame any more
  try {
    const Dispersion dispersion(network);
    FAIL() << "a network without datum was accepted";
  } catch (const AdjustmentError& error) {
    EXPECT_NE(std::string(error.what()).find("rank defect"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("c0 r"), std::string::npos) << error.what();
  }
}

// Conditions on the normal equations are what an adjustment with the
// parameters held gives (the problem is nearly linear at the solution).
TEST(Significance, LinearDropEqualsAdjustmentWithoutTheParameter) {
  std::mt19937 random(14);
  Network network = synthetic::MakeRig(&random, {});
  synthetic::AddNoise(&random, &network);
  SolveBundle(&network, {});
  Network other = network;
  std::vector<CameraMask> offered(2);
  offered[0][kE1] = offered[1][kE2] = true;
  const auto dropped = DropInsignificant(&network, Dispersion(network), offered, 1.0, 1e9);
  ASSERT_EQ(dropped.size(), 2u);
  other.cameras[0].free[kE1] = other.cameras[1].free[kE2] = false;
  other.cameras[0].camera.interior[kE1] = other.cameras[0].start[kE1];
  other.cameras[1].camera.interior[kE2] = other.cameras[1].start[kE2];
  SolveBundle(&other, {});
  const Dispersion dispersion(other);
  for (std::size_t c = 0; c < 2; ++c) {
    for (int k = 0; k < kNumInterior; ++k) {
      const int u = dispersion.index().camera[c][k];
      if (u < 0) continue;
      const double sigma = std::sqrt(dispersion.CovOrientation()(u, u));
      // Second-order terms: a small share of a standard deviation.
      EXPECT_NEAR(network.cameras[c].camera.interior[k], other.cameras[c].camera.interior[k],
                  0.05 * sigma)
          << kInteriorNames[k];
    }
  }
}

}  // namespace
}  // namespace videogrammetry
