#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "videogrammetry/adjustment/elimination.h"
#include "videogrammetry/adjustment/network.h"
#include "videogrammetry/core/errors.h"

namespace videogrammetry {

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

/// An image point's derivatives by the unknowns that are estimated.
struct ImageRow {
  static constexpr int kMaxUnknowns = kNumCameraUnknowns + 6 + 6 + kNumInterfaceUnknowns + 3;
  bool valid = false;  ///< false: the point has no picture
  int size = 0;
  std::array<int, kMaxUnknowns> unknown;
  Eigen::Matrix<double, 2, kMaxUnknowns> design;  ///< first `size` columns
  Eigen::Vector2d pixel;
};
ImageRow LineariseImagePoint(const Network& network, const UnknownIndex& index, int image,
                             int point, const Eigen::Vector2d& velocity_px);
/// The same of an observation, with what its residual is counted from (PredictObservation).
ImageRow LineariseObservation(const Network& network, const UnknownIndex& index,
                              const NetworkObservation& observation);

/// A scale bar's predicted length and its derivatives by the unknowns.
struct BarRow {
  int size = 0;
  std::array<int, 6> unknown;
  Eigen::Matrix<double, 1, 6> design;
  double length_mm = 0.0;
};
BarRow LineariseBar(const Network& network, const UnknownIndex& index, const NetworkScaleBar& bar);

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
  NormalEquations(const Network& network, const UnknownIndex& index,
                  const Elimination& elimination);

  Eigen::MatrixXd reduced;   ///< S, lower triangle
  Eigen::VectorXd diagonal;  ///< of N_rr, before the elimination
  std::vector<Block> blocks;
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
  void AddCameraPriors(const Network& network, const UnknownIndex& index);
  void AddInterfacePriors(const Network& network, const UnknownIndex& index);
  /// Adds a symmetric matrix over some unknowns.
  void Add(const int* unknown, int size, const Eigen::Ref<const Eigen::MatrixXd>& normal);
  void Eliminate(const Network& network, const UnknownIndex& index);

  const Elimination& elimination_;
};

}  // namespace videogrammetry
