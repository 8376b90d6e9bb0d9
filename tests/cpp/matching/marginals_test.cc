#include "videogrammetry/matching/marginals.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace videogrammetry {
namespace {

Candidate Set(std::vector<ViewTarget> used, double score) {
  Candidate candidate;
  candidate.used = std::move(used);
  candidate.score = score;
  return candidate;
}

TEST(Marginals, OneAloneHasItsOwnOdds) {
  std::vector<Candidate> candidates = {Set({{0, 0}, {1, 0}}, 2.0)};
  SetProbabilities({1, 1}, &candidates);
  EXPECT_NEAR(candidates[0].probability, 1 / (1 + std::exp(-2.0)), 1e-12);
}

// Two that share a target: Z = 1 + e^a + e^b.
TEST(Marginals, TwoThatExcludeEachOther) {
  std::vector<Candidate> candidates = {Set({{0, 0}, {1, 0}}, 1.0), Set({{0, 0}, {1, 1}}, 0.5)};
  const double z = 1 + std::exp(1.0) + std::exp(0.5);
  for (const int exact : {500, 0}) {
    SetProbabilities({1, 2}, &candidates, exact);
    // A tree: propagation is exact too, to its stop at changes of 1e-4.
    EXPECT_NEAR(candidates[0].probability, std::exp(1.0) / z, 2e-4) << exact;
    EXPECT_NEAR(candidates[1].probability, std::exp(0.5) / z, 2e-4) << exact;
  }
}

TEST(Marginals, ScoresBeyondTheExponentialsRange) {
  std::vector<Candidate> candidates = {Set({{0, 0}, {1, 0}}, 900.0), Set({{0, 0}, {1, 1}}, 890.0)};
  for (const int exact : {500, 0}) {
    SetProbabilities({1, 2}, &candidates, exact);
    EXPECT_NEAR(candidates[1].probability, 1 / (1 + std::exp(10.0)), 1e-4) << exact;
  }
}

TEST(Marginals, APartCountsItsWhole) {
  std::vector<Candidate> candidates = {Set({{0, 0}, {1, 0}, {2, 0}}, 1.0),
                                       Set({{0, 0}, {1, 0}}, 0.0)};
  SetProbabilities({1, 1, 1}, &candidates);
  const double z = 2 + std::exp(1.0);
  const std::vector<double> one_point = ProbabilitiesOfOnePoint({1, 1, 1}, candidates);
  EXPECT_NEAR(one_point[0], std::exp(1.0) / z, 1e-9);
  EXPECT_NEAR(one_point[1], (1 + std::exp(1.0)) / z, 1e-9);
}

// Random graphs between two and three cameras: propagation against the sum over all
// sets. Bethe's approximation on loops of a few candidates errs by some hundredths.
TEST(Marginals, PropagationIsNearTheSumOverAllSets) {
  for (const unsigned seed : {1U, 2U, 3U, 4U}) {
    std::mt19937 random(seed);
    std::uniform_int_distribution<int> target(0, 3);
    std::normal_distribution<double> score(0, 2);
    std::vector<Candidate> candidates;
    for (int k = 0; k < 9; ++k) {
      std::vector<ViewTarget> used = {{0, target(random)}, {1, target(random)}};
      if (k % 3 == 0) used.push_back({2, target(random)});
      candidates.push_back(Set(used, score(random)));
    }
    std::vector<Candidate> propagated = candidates;
    SetProbabilities({4, 4, 4}, &candidates, 1000000);
    SetProbabilities({4, 4, 4}, &propagated, 0);
    for (std::size_t k = 0; k < candidates.size(); ++k) {
      EXPECT_NEAR(propagated[k].probability, candidates[k].probability, 0.1)
          << "seed " << seed << ", candidate " << k;
    }
  }
}

}  // namespace
}  // namespace videogrammetry
