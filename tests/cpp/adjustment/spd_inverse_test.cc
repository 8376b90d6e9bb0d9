#include "videogrammetry/adjustment/spd_inverse.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

namespace videogrammetry {
namespace {

Eigen::MatrixXd Definite(Eigen::Index n) {
  std::srand(7);
  const Eigen::MatrixXd a = Eigen::MatrixXd::Random(n, n);
  return a * a.transpose() + 0.1 * static_cast<double>(n) * Eigen::MatrixXd::Identity(n, n);
}

// Condition below 20: a product of n terms leaves about n epsilon.
TEST(SpdInverse, InverseTimesMatrixIsIdentity) {
  for (const Eigen::Index n : {1, 7, 256, 257, 700}) {
    for (const int threads : {1, 3}) {
      const Eigen::MatrixXd a = Definite(n);
      Eigen::MatrixXd inverse = a;
      EXPECT_GT(FactorInPlace(&inverse, threads), 0.0);
      InvertFactorInPlace(&inverse, threads);
      const Eigen::MatrixXd whole = inverse.selfadjointView<Eigen::Lower>();
      EXPECT_LT((whole * a - Eigen::MatrixXd::Identity(n, n)).cwiseAbs().maxCoeff(), 1e-11)
          << n << " with " << threads << " threads";
    }
  }
}

TEST(SpdInverse, FactorLeavesTheUpperTriangle) {
  const Eigen::MatrixXd a = Definite(600);
  Eigen::MatrixXd factor = a;
  FactorInPlace(&factor, 2);
  const Eigen::MatrixXd l = factor.triangularView<Eigen::Lower>();
  EXPECT_LT((l * l.transpose() - a).cwiseAbs().maxCoeff(), 1e-12 * a.diagonal().maxCoeff() * 600);
  for (Eigen::Index j = 1; j < 600; ++j) {
    for (Eigen::Index i = 0; i < j; ++i) ASSERT_EQ(factor(i, j), a(i, j)) << i << " " << j;
  }
}

TEST(SpdInverse, SaysWhereAMatrixIsNotDefinite) {
  Eigen::MatrixXd a = Definite(500);
  a(400, 400) = -1.0;
  EXPECT_FALSE(FactorInPlace(&a, 1) > 0);
}

}  // namespace
}  // namespace videogrammetry
