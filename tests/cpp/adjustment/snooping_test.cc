#include "videogrammetry/adjustment/snooping.h"

#include <gtest/gtest.h>

#include "synthetic.h"
#include "videogrammetry/adjustment/adjust.h"

namespace videogrammetry {
namespace {

// One error of 8 sigma in one coordinate: w is about 8 sqrt(redundancy) > 6.
TEST(Snooping, FindsTheOneWrongObservation) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    std::mt19937 random(seed);
    Network network = synthetic::MakeRig(&random, {});
    synthetic::AddNoise(&random, &network);
    network.observations[100].xy_px.x() += 8 * 0.02;
    AdjustOptions options;
    options.critical_value = 4.5;  // 7e-6: no good one of 360 is rejected
    options.estimate_floor = false;
    Adjust(&network, options);
    for (std::size_t i = 0; i < network.observations.size(); ++i) {
      EXPECT_EQ(network.observations[i].used, i != 100) << "seed " << seed << " at " << i;
    }
  }
}

TEST(Snooping, RejectsOneAPictureAndOneAPointInARound) {
  std::mt19937 random(4);
  Network network = synthetic::MakeRig(&random, {});
  std::vector<ObservationStatistics> statistics(network.observations.size());
  for (ObservationStatistics& s : statistics) s.valid = true;
  statistics[0].normalised.x() = 9;
  statistics[1].normalised.x() = 12;  // same picture: goes first, alone
  std::vector<int> rounds(statistics.size());
  const SnoopingChange change = SnoopOnce(&network, statistics, 3.29, &rounds);
  EXPECT_EQ(change.rejected, 1);
  EXPECT_TRUE(network.observations[0].used);
  EXPECT_FALSE(network.observations[1].used);
}

TEST(Snooping, ReadmitsOnceOnly) {
  std::mt19937 random(5);
  Network network = synthetic::MakeRig(&random, {});
  std::vector<ObservationStatistics> statistics(network.observations.size());
  for (ObservationStatistics& s : statistics) s.valid = true;
  std::vector<int> rounds(statistics.size());
  network.observations[7].used = false;
  rounds[7] = 1;
  EXPECT_EQ(SnoopOnce(&network, statistics, 3.29, &rounds).readmitted, 1);
  network.observations[7].used = false;
  rounds[7] = 2;
  EXPECT_EQ(SnoopOnce(&network, statistics, 3.29, &rounds).readmitted, 0);
}

}  // namespace
}  // namespace videogrammetry
