#include "videogrammetry/adjustment/variance.h"

#include <gtest/gtest.h>

#include "synthetic.h"
#include "videogrammetry/adjustment/adjust.h"

namespace videogrammetry {
namespace {

// The floor's variance c^2 = s^2 - e^2 scatters by about s^2 sqrt(2 / r); five such.
TEST(Variance, FloorIsFoundPerCamera) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    std::mt19937 random(seed);
    Network network = synthetic::MakeRig(&random, {});
    synthetic::AddNoise(&random, &network);
    const double extra = 0.06;
    for (NetworkObservation& o : network.observations) {
      if (network.camera_of(o) != 1) continue;
      for (int k = 0; k < 2; ++k) o.xy_px[k] += synthetic::Normal(&random, extra);
    }
    AdjustOptions options;
    options.critical_value = 0;
    const AdjustResult result = Adjust(&network, options);
    const double s2 = extra * extra + 4e-4;
    const double slack = 5 * s2 * std::sqrt(2.0 / result.cameras[1].redundancy);
    EXPECT_NEAR(std::pow(network.cameras[1].floor_px, 2), extra * extra, slack) << "seed " << seed;
    EXPECT_EQ(network.cameras[0].floor_px, 0.0) << "seed " << seed;
    EXPECT_NEAR(result.sigma0, 1.0, 4 / std::sqrt(2.0 * result.redundancy)) << "seed " << seed;
  }
}

// Stated three times too large: the scale 1/9 scatters by sqrt(2 / r) of itself.
TEST(Variance, StatedCovariancesThatAreTooLargeAreScaled) {
  std::mt19937 random(7);
  Network network = synthetic::MakeRig(&random, {});
  synthetic::AddNoise(&random, &network);
  for (NetworkObservation& o : network.observations) o.cov_px2 *= 9;
  AdjustOptions options;
  options.critical_value = 0;
  const AdjustResult result = Adjust(&network, options);
  for (std::size_t c = 0; c < 2; ++c) {
    EXPECT_NEAR(network.cameras[c].cov_scale, 1.0 / 9,
                5.0 / 9 * std::sqrt(2.0 / result.cameras[c].redundancy));
    EXPECT_EQ(network.cameras[c].floor_px, 0.0);
  }
}

TEST(Variance, TruncatedNormal) {
  EXPECT_EQ(TruncatedVariance(0.0), 1.0);
  // By hand for k = 1: 1 - 2 * 0.2419707 / 0.6826895.
  EXPECT_NEAR(TruncatedVariance(1.0), 0.2911251, 1e-6);
  EXPECT_NEAR(TruncatedVariance(8.0), 1.0, 1e-12);
}

}  // namespace
}  // namespace videogrammetry
