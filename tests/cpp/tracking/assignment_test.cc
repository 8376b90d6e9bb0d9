#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "videogrammetry/tracking/point_index.h"
#include "videogrammetry/tracking/sparse_assignment.h"

namespace videogrammetry {
namespace {

// Best total over all assignments, `banned` (track, row) not used; -2 as row: must have a row.
double Best(const std::vector<std::vector<double>>& odds, int banned_track, int banned_row) {
  const int rows = static_cast<int>(odds[0].size());
  std::vector<char> used(odds[0].size(), 0);
  const std::function<double(std::size_t)> visit = [&](std::size_t t) -> double {
    if (t == odds.size()) return 0.0;
    double best = -1e300;
    if (!(static_cast<int>(t) == banned_track && banned_row == -1)) best = visit(t + 1);
    for (int r = 0; r < rows; ++r) {
      const auto u = static_cast<std::size_t>(r);
      if (used[u] || odds[t][u] <= 0 || (static_cast<int>(t) == banned_track && r == banned_row)) {
        continue;
      }
      used[u] = 1;
      best = std::max(best, odds[t][u] + visit(t + 1));
      used[u] = 0;
    }
    return best;
  };
  return visit(0);
}

TEST(AssignRows, EqualsEnumerationWithMargins) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> draw(-6.0, 8.0);
  for (int trial = 0; trial < 300; ++trial) {
    const int tracks = 1 + trial % 5, rows = 1 + (trial / 5) % 5;
    std::vector<std::vector<double>> odds(static_cast<std::size_t>(tracks));
    std::vector<LinkCandidate> candidates;
    for (int t = 0; t < tracks; ++t) {
      for (int r = 0; r < rows; ++r) {
        odds[static_cast<std::size_t>(t)].push_back(draw(random));
        const double value = odds[static_cast<std::size_t>(t)].back();
        if (value > 0) candidates.push_back({t, r, value});
      }
    }
    const auto links = AssignRows(tracks, rows, candidates, 1.0, nullptr);
    double total = 0.0;
    for (int t = 0; t < tracks; ++t) {
      const int row = links[static_cast<std::size_t>(t)].row;
      if (row >= 0) total += odds[static_cast<std::size_t>(t)][static_cast<std::size_t>(row)];
    }
    const double best = Best(odds, -1, -1);
    ASSERT_NEAR(total, best, 1e-9) << "trial " << trial;
    for (int t = 0; t < tracks; ++t) {
      const auto& link = links[static_cast<std::size_t>(t)];
      const double without = Best(odds, t, link.row);
      if (without < -1e299) {
        EXPECT_TRUE(std::isinf(link.margin)) << "trial " << trial;
      } else {
        EXPECT_NEAR(link.margin, best - without, 1e-9) << "trial " << trial << " track " << t;
      }
    }
  }
}

TEST(PointIndex, EqualsSearchThroughAll) {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> draw(0.0, 10.0);
  for (const int n : {0, 1, 31, 32, 33, 500}) {
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < n; ++i) points.emplace_back(draw(random), draw(random), draw(random));
    if (n > 40) std::fill(points.begin(), points.begin() + 40, points[0]);  // many at one place
    const PointIndex index(points);
    for (int trial = 0; trial < 50; ++trial) {
      const Eigen::Vector3d place(draw(random), draw(random), draw(random));
      std::vector<std::pair<double, int>> all;
      for (int i = 0; i < n; ++i) {
        const double d2 = (points[static_cast<std::size_t>(i)] - place).squaredNorm();
        if (d2 <= 9.0) all.emplace_back(d2, i);
      }
      std::sort(all.begin(), all.end());
      if (all.size() > 7) all.resize(7);
      std::vector<PointIndex::Neighbour> found;
      index.Nearest(place, 7, 3.0, &found);
      ASSERT_EQ(found.size(), all.size()) << n;
      for (std::size_t k = 0; k < all.size(); ++k) EXPECT_EQ(found[k].distance2, all[k].first);
    }
  }
}

}  // namespace
}  // namespace videogrammetry
