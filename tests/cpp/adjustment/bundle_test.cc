#include "videogrammetry/adjustment/bundle.h"

#include <gtest/gtest.h>

#include "synthetic.h"
#include "videogrammetry/adjustment/adjust.h"
#include "videogrammetry/core/errors.h"

namespace videogrammetry {
namespace {

// Exact pictures and points: the minimum is zero and the unknowns are the
// truth; what remains is rounding of the projection (1e-10 px).
TEST(Bundle, FindsExactTruthFromDisturbedStart) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    std::mt19937 random(seed);
    const Network truth = synthetic::MakeRig(&random, {});
    Network network = truth;
    synthetic::Disturb(&random, 1.0, &network);
    BundleOptions options;
    options.near_solution = false;
    const BundleSummary summary = SolveBundle(&network, options);
    EXPECT_TRUE(summary.converged) << "seed " << seed << ": " << summary.message;
    EXPECT_LT(summary.final_cost, 1e-8) << "seed " << seed;
    for (std::size_t c = 0; c < truth.cameras.size(); ++c) {
      EXPECT_NEAR(network.cameras[c].camera.f_px(), truth.cameras[c].camera.f_px(), 1e-4)
          << "seed " << seed;
      EXPECT_LT(
          (network.poses[c].transform.translation_mm - truth.poses[c].transform.translation_mm)
              .norm(),
          1e-3)
          << "seed " << seed;
    }
  }
}

TEST(Bundle, HoldsWhatIsNotFree) {
  std::mt19937 random(4);
  Network network = synthetic::MakeRig(&random, {});
  synthetic::AddNoise(&random, &network);
  const InteriorVector before = network.cameras[0].camera.interior;
  const Rigid3 reference = network.poses[0].transform;
  network.cameras[0].free.fill(false);
  SolveBundle(&network, {});
  EXPECT_LT((network.cameras[0].camera.interior - before).cwiseQuotient(before).norm(), 1e-15);
  EXPECT_EQ(network.poses[0].transform.rotation, reference.rotation);
  EXPECT_NE(network.cameras[1].camera.interior[kF], network.cameras[1].start[kF]);
}

TEST(Bundle, NamesMalformedInput) {
  std::mt19937 random(5);
  Network network = synthetic::MakeRig(&random, {});
  network.observations[3].cov_px2.setZero();
  EXPECT_THROW(SolveBundle(&network, {}), std::invalid_argument);
  network = synthetic::MakeRig(&random, {});
  network.images[0].camera = 7;
  EXPECT_THROW(SolveBundle(&network, {}), std::invalid_argument);
}

// The robust start must lead to the least-squares solution of the good
// observations although 5 % are off by up to 300 px.
TEST(Adjust, GrossErrorsAreRejectedAndChangeNothing) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    std::mt19937 random(seed);
    Network clean = synthetic::MakeRig(&random, {});
    synthetic::AddNoise(&random, &clean);
    Network spoiled = clean;
    int count = 0;
    for (std::size_t i = 0; i < spoiled.observations.size(); i += 20) {
      spoiled.observations[i].xy_px += Eigen::Vector2d(50 + synthetic::Uniform(&random, 300), 40);
      clean.observations[i].used = false;
      ++count;
    }
    AdjustOptions options;
    options.critical_value = 0;
    options.robust_start = false;
    Adjust(&clean, options);
    synthetic::Disturb(&random, 1.0, &spoiled);
    options = {};
    options.critical_value = 6.0;  // far from any good observation: the sets are equal
    const AdjustResult result = Adjust(&spoiled, options);
    for (std::size_t i = 0; i < spoiled.observations.size(); ++i) {
      EXPECT_EQ(spoiled.observations[i].used, i % 20 != 0) << "seed " << seed << " at " << i;
    }
    EXPECT_GT(count, 10);
    EXPECT_NEAR(spoiled.cameras[1].camera.f_px(), clean.cameras[1].camera.f_px(), 2e-3)
        << "seed " << seed;
    EXPECT_TRUE(result.converged);
  }
}

TEST(Adjust, HoldsAStageWithoutObservations) {
  std::mt19937 random(6);
  Network network = synthetic::MakeRig(&random, {});
  synthetic::AddNoise(&random, &network);
  for (NetworkObservation& o : network.observations) {
    if (network.images[o.image].inner == 3 && o.point > 1) o.used = false;
  }
  AdjustOptions options;
  options.critical_value = 0;
  options.robust_start = false;
  Adjust(&network, options);
  EXPECT_FALSE(network.poses[3].free);
  EXPECT_TRUE(network.poses[4].free);
}

TEST(Adjust, TooFewObservationsAreAnError) {
  std::mt19937 random(7);
  synthetic::Options few;
  few.num_cameras = 1;
  few.num_stages = 1;
  few.num_points = 6;
  Network network = synthetic::MakeRig(&random, few);
  for (NetworkPoint& p : network.points) p.kind = PointKind::kFixed;
  network.poses[0].free = false;
  EXPECT_THROW(Adjust(&network, {}), AdjustmentError);
}

}  // namespace
}  // namespace videogrammetry
