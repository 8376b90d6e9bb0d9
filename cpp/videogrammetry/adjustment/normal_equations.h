#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "videogrammetry/adjustment/elimination.h"
#include "videogrammetry/adjustment/linearise.h"
#include "videogrammetry/adjustment/network.h"
#include "videogrammetry/core/errors.h"

namespace videogrammetry {

/// Below this share of its unit diagonal a pivot is rounding: about 1e4 times
/// the double's epsilon, and far under what a solvable network shows (1e-9).
constexpr double kRankTolerance = 1e-12;

/// The observations do not determine a point's position.
class UndeterminedPointError : public AdjustmentError {
 public:
  UndeterminedPointError(const std::string& what, int point)
      : AdjustmentError(what), point_(point) {}
  /// Its index.
  int point() const { return point_; }

 private:
  int point_;
};

/// Unknowns of a row of the design that lie next to each other in one block or in the
/// reduced vector (block -1).
struct UnknownRun {
  int row = 0;  ///< the first one's place in the row
  int size = 0;
  int block = -1;
  int place = 0;  ///< the first one's, in its block or the reduced vector
};
/// Splits `size` unknowns into runs, at most `size` of them; returns their number.
int FindRuns(const Elimination& elimination, const int* unknown, int size, UnknownRun* runs);

/// Lower triangle of the reduced normal equations scaled to a unit diagonal (before the
/// elimination), made regular along the null space's columns.
Eigen::MatrixXd ScaledReduced(const Eigen::MatrixXd& reduced, const Eigen::VectorXd& diagonal,
                              const Elimination& elimination, const Eigen::MatrixXd& null_space);

/// How normal equations are made while an adjustment is on its way.
struct NormalOptions {
  /// Scale of Cauchy's loss in standard deviations; 0 = least squares. Every image point, bar
  /// and a-priori position gets the weight 1 / (1 + v'Pv / scale^2).
  double cauchy_scale = 0.0;
  /// Share by which the diagonal is raised (Levenberg-Marquardt).
  double damping = 0.0;
};

/// Normal equations N = A'PA of a network at its present values, with blocks
/// of unknowns b eliminated (Elimination):
///   S = N_rr - sum_b N_rb N_bb^-1 N_br,   Y_b = N_bb^-1 N_br.
struct NormalEquations {
  /// One eliminated block; it meets only the reduced vector's `columns`.
  struct Block {
    std::vector<int> columns;  // ascending
    Eigen::MatrixXd normal;    // N_bb
    Eigen::MatrixXd coupling;  // N_br, (b, columns)
    Eigen::MatrixXd inverse;   // N_bb^-1
    Eigen::MatrixXd y;         // Y_b

    /// Place of a reduced unknown in `columns`, -1 = not met.
    int Column(int reduced_place) const;
  };

  /// @throws AdjustmentError if a block is singular, naming it; of a point
  ///     UndeterminedPointError.
  NormalEquations(const Network& network, const UnknownIndex& index, const Elimination& elimination,
                  const NormalOptions& options = {});

  /// Answer dx to N dx = A'Pv, of every unknown in order, free of the null space's directions;
  /// nullopt where N is singular.
  std::optional<Eigen::VectorXd> Solve(const Eigen::MatrixXd& null_space, int num_threads) const;

  Eigen::MatrixXd reduced;   ///< S, lower triangle
  Eigen::VectorXd diagonal;  ///< of N_rr, before the elimination
  std::vector<Block> blocks;
  Eigen::VectorXd gradient;       ///< A'Pv of every unknown, before the elimination
  double cost = 0.0;              ///< v'Pv, or the sum of the loss
  int num_invalid = 0;            ///< used image points without a picture; they take no part
  int num_observations = 0;       ///< used image coordinates
  int num_prior = 0;              ///< a-priori coordinates, parameters and scale bars
  double weighted_squares = 0.0;  ///< v'Pv of everything
  double point_squares = 0.0;     ///< of the points' a-priori positions
  double bar_squares = 0.0;       ///< of the scale bars

 private:
  void FindColumns(const Network& network, const UnknownIndex& index);
  void AddImagePoints(const Network& network, const UnknownIndex& index);
  void AddBars(const Network& network, const UnknownIndex& index);
  void AddPointPriors(const Network& network, const UnknownIndex& index);
  void AddPriorBlock(const Network& network, const UnknownIndex& index);
  /// Adds the a-priori value of an unknown that is not eliminated, in no loss.
  void AddPrior(int unknown, double residual, double sigma);
  void AddCameraPriors(const Network& network, const UnknownIndex& index);
  void AddInterfacePriors(const Network& network, const UnknownIndex& index);
  /// Adds a symmetric matrix over some unknowns, and the right-hand side.
  void Add(const int* unknown, int size, const Eigen::Ref<const Eigen::MatrixXd>& normal,
           const Eigen::Ref<const Eigen::VectorXd>& right);
  struct CommonRows;
  void Flush(CommonRows* rows);
  /// The parts of an image point's row that belong to its point's unknowns.
  void AddToPoint(const ImageRow& row,
                  const Eigen::Matrix<double, 2, ImageRow::kMaxUnknowns>& weighted,
                  const Eigen::Vector2d& residual);
  /// Weight by the loss of an observation with this v'Pv, which it counts.
  double LossWeight(double square);
  void Damp();
  void Eliminate(const Network& network, const UnknownIndex& index);

  const Elimination& elimination_;
  NormalOptions options_;
};

}  // namespace videogrammetry
