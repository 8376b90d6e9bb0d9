#include "videogrammetry/adjustment/elimination.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "synthetic.h"
#include "videogrammetry/adjustment/bundle.h"
#include "videogrammetry/adjustment/datum.h"
#include "videogrammetry/adjustment/dispersion.h"

namespace videogrammetry {
namespace {

/// A rig around a free object: some points in pairs on bars (wands).
Network MakeFree(unsigned seed, int num_bars) {
  std::mt19937 random(seed);
  Network network = synthetic::MakeRig(&random, {});
  network.datum = Datum::kFree;
  for (NetworkPoint& p : network.points) p.kind = PointKind::kFree;
  for (int b = 0; b < num_bars; ++b) {
    const NetworkPoint &from = network.points[2 * b], &to = network.points[2 * b + 1];
    network.scale_bars.push_back(
        {2 * b, 2 * b + 1, (from.position_mm - to.position_mm).norm(), 0.01});
  }
  return network;
}

double RelativeDifference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  const Eigen::VectorXd scale = b.diagonal().cwiseSqrt().cwiseInverse();
  return (scale.asDiagonal() * (a - b) * scale.asDiagonal()).cwiseAbs().maxCoeff();
}

/// The whole normal matrix, undivided: no block is eliminated.
Eigen::MatrixXd WholeNormal(const Network& network, const UnknownIndex& index) {
  Eigen::MatrixXd n = Eigen::MatrixXd::Zero(index.num_unknowns, index.num_unknowns);
  auto add = [&](const std::vector<int>& unknown, const Eigen::MatrixXd& normal) {
    n(unknown, unknown) += normal;
  };
  for (const NetworkObservation& o : network.observations) {
    const ImageRow row = LineariseImagePoint(network, index, o.image, o.point, o.velocity_px);
    const auto a = row.design.leftCols(row.size);
    add({row.unknown.begin(), row.unknown.begin() + row.size},
        a.transpose() * o.cov_px2.inverse() * a);
  }
  for (const NetworkScaleBar& bar : network.scale_bars) {
    const BarRow row = LineariseBar(network, index, bar);
    const auto a = row.design.leftCols(row.size);
    add({row.unknown.begin(), row.unknown.begin() + row.size},
        a.transpose() * a / (bar.sigma_mm * bar.sigma_mm));
  }
  return n;
}

TEST(Elimination, TakesTheSmallerSystem) {
  const Network few_points = MakeFree(1, 0);  // 30 points, 6 stages: poses leave more
  const UnknownIndex index(few_points);
  EXPECT_EQ(Elimination(few_points, index).reduced.size(),
            static_cast<std::size_t>(index.num_orientation));
  std::mt19937 random(2);
  synthetic::Options options;
  options.num_cameras = 1;
  options.num_stages = 40;
  options.num_points = 10;
  Network many_pictures = synthetic::MakeRig(&random, options);
  many_pictures.poses[0].free = false;
  const UnknownIndex other(many_pictures);
  EXPECT_EQ(Elimination(many_pictures, other).reduced.size(),
            static_cast<std::size_t>(other.num_unknowns - 6 * 40));
}

TEST(Elimination, WandsAreEliminatedAsPairsAndLongChainsStay) {
  Network network = MakeFree(3, 4);
  const UnknownIndex index(network);
  int pairs = 0;
  for (const auto& block : Elimination(network, index).blocks) pairs += block.size() == 6;
  EXPECT_EQ(pairs, 4);
  for (int p = 0; p < 6; ++p) network.scale_bars.push_back({p, p + 1, 100.0, 0.01});
  const Elimination chained(network, index, Elimination::What::kPoints);
  for (int p = 0; p < 8; ++p) EXPECT_EQ(chained.block_of[index.point[p]], -1) << p;
  EXPECT_GE(chained.block_of[index.point[8]], 0);
}

// Both ways are the same algebra; what differs is rounding: the scaled matrix' condition
// (1e7 here) times epsilon.
TEST(Elimination, ByPosesEqualsByPoints) {
  for (const int bars : {0, 3}) {
    const Network network = MakeFree(4, bars);
    const Dispersion by_points(network, Elimination::What::kPoints);
    const Dispersion by_poses(network, Elimination::What::kPoses);
    EXPECT_NE(by_points.num_reduced(), by_poses.num_reduced());
    const Eigen::MatrixXd a = by_points.FullCovariance(), b = by_poses.FullCovariance();
    EXPECT_LT(RelativeDifference(a, b), 1e-9) << bars << " bars";
    const auto of_points = by_points.Statistics(), of_poses = by_poses.Statistics();
    for (std::size_t i = 0; i < of_points.size(); ++i) {
      EXPECT_LT((of_points[i].redundancy - of_poses[i].redundancy).norm(), 1e-8);
    }
    std::vector<int> all(static_cast<std::size_t>(a.rows()));
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<int>(i);
    EXPECT_LT(RelativeDifference(by_points.Covariance(all, all), a), 1e-10);
    EXPECT_LT(RelativeDifference(by_poses.Covariance(all, all), b), 1e-10);
  }
}

// The null space is exact: N G = 0 to rounding of the products.
TEST(Datum, NormalEquationsKnowNothingOfTheFrame) {
  for (const int bars : {0, 3}) {
    const Network network = MakeFree(5, bars);
    const UnknownIndex index(network);
    const Eigen::MatrixXd n = WholeNormal(network, index), g = DatumNullSpace(network, index);
    EXPECT_EQ(g.cols(), bars > 0 ? 6 : 7);
    const Eigen::VectorXd root = n.diagonal().cwiseSqrt();
    for (Eigen::Index k = 0; k < g.cols(); ++k) {
      const Eigen::VectorXd scaled = root.cwiseProduct(g.col(k)).normalized();
      const Eigen::VectorXd answer =
          root.cwiseInverse().asDiagonal() * n * root.cwiseInverse().asDiagonal() * scaled;
      EXPECT_LT(answer.norm(), 1e-12) << "column " << k << ", " << bars << " bars";
    }
  }
}

// Inner constraints by the bordered system [N E; E' 0] with E = G on the points: its inverse'
// corner is the covariance (Koch, Parameter Estimation and Hypothesis Testing, 3.6).
TEST(Datum, CovarianceEqualsTheBorderedSystem) {
  for (const int bars : {0, 3}) {
    const Network network = MakeFree(6, bars);
    const Dispersion dispersion(network);
    const UnknownIndex& index = dispersion.index();
    const Eigen::MatrixXd n = WholeNormal(network, index), g = DatumNullSpace(network, index);
    const Eigen::Index u = n.rows(), d = g.cols();
    const Eigen::VectorXd scale = n.diagonal().cwiseSqrt().cwiseInverse();
    Eigen::MatrixXd bordered = Eigen::MatrixXd::Zero(u + d, u + d);
    bordered.topLeftCorner(u, u) = scale.asDiagonal() * n * scale.asDiagonal();
    Eigen::MatrixXd e = g;
    e.topRows(index.num_orientation).setZero();
    e = scale.asDiagonal() * e;
    for (Eigen::Index k = 0; k < d; ++k) e.col(k).normalize();
    bordered.topRightCorner(u, d) = e;
    bordered.bottomLeftCorner(d, u) = e.transpose();
    const Eigen::MatrixXd expected = scale.asDiagonal() *
                                     bordered.fullPivLu().inverse().topLeftCorner(u, u) *
                                     scale.asDiagonal();
    EXPECT_LT(RelativeDifference(dispersion.FullCovariance(), expected), 1e-7) << bars << " bars";
  }
}

}  // namespace
}  // namespace videogrammetry
