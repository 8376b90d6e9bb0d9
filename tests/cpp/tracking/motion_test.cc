#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "videogrammetry/tracking/motion_state.h"
#include "videogrammetry/tracking/motion_statistics.h"
#include "videogrammetry/tracking/neighbour_motion.h"
#include "videogrammetry/tracking/return_statistics.h"
#include "videogrammetry/tracking/smoother.h"

namespace videogrammetry {
namespace {

constexpr double kSigma = 0.05;

// Points that move as the model says, from rest at random places.
PointTable Walk(std::size_t stages, std::size_t points, const MotionModel& model, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto draw = [&](double sigma) {
    return Eigen::Vector3d(sigma * normal(random), sigma * normal(random), sigma * normal(random));
  };
  PointTable table{stages, points, {}, {}, {}};
  table.position_mm.resize(stages * points);
  table.cov_mm2.assign(stages * points, kSigma * kSigma * Eigen::Matrix3d::Identity());
  table.seen.assign(stages * points, 1);
  const double s = std::sqrt(model.acceleration_var);
  for (std::size_t p = 0; p < points; ++p) {
    Eigen::Vector3d x = draw(300.0), v = draw(2.0), a = draw(s);
    for (std::size_t k = 0; k < stages; ++k) {
      table.position_mm[table.at(k, p)] = x;
      x += v + 0.5 * a;
      v += a;
      a = model.correlation * a + draw(s * std::sqrt(1 - std::pow(model.correlation, 2)));
    }
  }
  return table;
}

PointTable Measured(PointTable table, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, kSigma);
  for (auto& x : table.position_mm)
    x += Eigen::Vector3d(normal(random), normal(random), normal(random));
  return table;
}

TEST(MotionStatistics, FindsTheModel) {
  for (const double rho : {0.0, 0.6, 0.95}) {
    const MotionModel model{0.04, rho};
    const MotionModel found = LearnMotion(Measured(Walk(40, 200, model, 1), 2));
    // The variance is the mean of 200 points' squares over 40 stages that are
    // correlated over 1 / (1 - rho): 3 * 200 * max(40 (1 - rho), 1) independent numbers.
    const double n = 600.0 * std::max(40.0 * (1.0 - rho), 1.0);
    EXPECT_NEAR(found.acceleration_var / 0.04, 1.0, 5.0 * std::sqrt(2.0 / n) + 0.02) << rho;
    EXPECT_NEAR(found.correlation, rho, 0.05) << rho;
  }
}

TEST(MotionState, PredictionErrorsHaveTheirCovariance) {
  const MotionModel model{0.01, 0.8};
  const PointTable truth = Walk(40, 400, model, 3), measured = Measured(truth, 4);
  for (const std::size_t gap : {1u, 3u, 10u}) {
    double sum = 0.0;
    for (std::size_t p = 0; p < truth.points; ++p) {
      MotionState state =
          StartState(measured.position_mm[truth.at(0, p)], measured.cov_mm2[0],
                     Eigen::Vector3d::Zero(), 4.0 * Eigen::Matrix3d::Identity(), model);
      for (std::size_t k = 1; k < 30; ++k) {
        state = Update(Predict(state, model), measured.position_mm[truth.at(k, p)],
                       measured.cov_mm2[0]);
      }
      for (std::size_t k = 0; k < gap; ++k) state = Predict(state, model);
      sum += Compare(truth.position_mm[truth.at(29 + gap, p)] - state.position_mm(),
                     state.position_cov_mm2())
                 .distance2;
    }
    // Chi-square of 1200: standard deviation of the mean of d^2 / 3 is sqrt(2 / 1200) = 0.041.
    EXPECT_NEAR(sum / 1200.0, 1.0, 4.0 * 0.041) << "gap " << gap;
  }
}

TEST(FillGaps, ErrorsHaveTheirCovariance) {
  for (const double rho : {0.3, 0.95}) {
    for (const std::size_t gap : {1u, 5u, 20u}) {
      const PointTable truth = Walk(60, 300, {0.01, rho}, 5);
      PointTable table = Measured(truth, 6);
      for (std::size_t p = 0; p < table.points; p += 3) {
        for (std::size_t s = 20; s < 20 + gap; ++s) table.seen[table.at(s, p)] = 0;
      }
      FillOptions options;
      options.largest_gap = 20;
      const std::vector<char> filled = FillGaps(&table, options);
      double sum = 0.0;
      int count = 0;
      const std::size_t middle = 20 + gap / 2;
      for (std::size_t p = 0; p < table.points; ++p) {
        const std::size_t k = table.at(middle, p);
        EXPECT_EQ(filled[k] != 0, p % 3 == 0);
        if (!filled[k]) continue;
        sum += Compare(truth.position_mm[k] - table.position_mm[k], table.cov_mm2[k]).distance2;
        ++count;
      }
      ASSERT_EQ(count, 100);
      // 300 numbers: 0.082; the learnt model and the 200 cut gaps' factor add 10 %.
      EXPECT_NEAR(sum / 300.0, 1.0, 4.0 * 0.082 + 0.1) << "gap " << gap << " rho " << rho;
    }
  }
}

TEST(FillGaps, NeighboursFillWhereABodyIsThrown) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  PointTable truth{30, 40, {}, {}, {}};
  std::vector<Eigen::Vector3d> body;
  for (int i = 0; i < 40; ++i)
    body.emplace_back(200 * normal(random), 200 * normal(random), 50 * normal(random));
  for (int s = 0; s < 30; ++s) {
    const Eigen::Matrix3d rotation =
        RotationFromVector({normal(random), normal(random), normal(random)});
    const Eigen::Vector3d shift(300 * normal(random), 300 * normal(random), 0);
    for (const auto& x : body) truth.position_mm.push_back(rotation * x + shift);
  }
  truth.cov_mm2.assign(1200, kSigma * kSigma * Eigen::Matrix3d::Identity());
  truth.seen.assign(1200, 1);
  PointTable table = Measured(truth, 8);
  for (std::size_t s = 5; s < 25; ++s) {
    for (std::size_t p = s % 4; p < 40; p += 4) table.seen[table.at(s, p)] = 0;
  }
  const std::vector<char> filled = FillGaps(&table, {});
  double sum = 0.0;
  int count = 0;
  for (std::size_t k = 0; k < filled.size(); ++k) {
    if (!filled[k]) continue;
    const Innovation e = Compare(truth.position_mm[k] - table.position_mm[k], table.cov_mm2[k]);
    sum += e.distance2;
    ++count;
  }
  EXPECT_EQ(count, 200);
  // Two ends are averaged and their covariance is not halved: at best 0.5, never above 1
  // by more than four deviations of 600 numbers.
  EXPECT_LT(sum / (3.0 * count), 1.0 + 4.0 * std::sqrt(2.0 / 600.0));
  EXPECT_GT(sum / (3.0 * count), 0.4);
}

TEST(FillGaps, LongGapsAndEndsStay) {
  PointTable table = Measured(Walk(40, 3, {0.01, 0.5}, 9), 10);
  for (std::size_t s = 10; s < 21; ++s) table.seen[table.at(s, 0)] = 0;  // 11 stages
  for (std::size_t s = 0; s < 4; ++s) table.seen[table.at(s, 1)] = 0;    // before the first
  for (std::size_t s = 35; s < 40; ++s) table.seen[table.at(s, 2)] = 0;  // after the last
  const auto filled = FillGaps(&table, {});
  EXPECT_EQ(std::count(filled.begin(), filled.end(), 1), 0);
  EXPECT_THROW(FillGaps(&table, {.largest_gap = -1}), std::invalid_argument);
  table.seen.pop_back();
  EXPECT_THROW(FillGaps(&table, {}), std::invalid_argument);
}

TEST(ReturnStatistics, LearnsTheShareThatReturnsByTheGap) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> one;
  ReturnStatistics returns;
  for (int stage = 0; stage < 400; ++stage) {
    for (int k = 0; k < 20; ++k) {
      returns.Add(2, one(random) < 0.9);
      returns.Add(20, one(random) < 0.02);
    }
    returns.Commit();
  }
  // 64 stages of 20 are remembered: of shares p, log odds scatter by 1 / sqrt(n p (1 - p)).
  EXPECT_NEAR(returns.LogOdds(2), std::log(0.9 / 0.1), 5.0 / std::sqrt(1280 * 0.9 * 0.1));
  EXPECT_NEAR(returns.LogOdds(20), std::log(0.02 / 0.98), 5.0 / std::sqrt(1280 * 0.02 * 0.98));
  // Of other gaps nothing is known yet: they are taken for hidden rather than gone.
  EXPECT_GT(returns.LogOdds(7), 0.0);
}

}  // namespace
}  // namespace videogrammetry
