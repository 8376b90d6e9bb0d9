#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "videogrammetry/adjustment/network.h"

namespace videogrammetry {

/// What an adjustment says about one observation, per coordinate.
struct ObservationStatistics {
  /// False where the point has no picture at the adjusted values.
  bool valid = false;
  Eigen::Vector2d residual_px = Eigen::Vector2d::Zero();  ///< measured - adjusted
  /// Baarda's w = (P v)_i / sqrt((P Qvv P)_ii), standard normal if the
  /// observation is good. Of an unused observation: v over its standard
  /// deviation, the adjusted position's included.
  Eigen::Vector2d normalised = Eigen::Vector2d::Zero();
  /// Diagonal of Qvv P: the share of an error that shows in its own residual.
  Eigen::Vector2d redundancy = Eigen::Vector2d::Zero();
  double weighted_square = 0.0;  ///< v'Pv
};

/// A-priori dispersion of the unknowns of a network at its present values.
///
/// Normal equations N = A'PA with the object points eliminated (each point's
/// unknowns meet only pictures): S = Ncc - Ncp Npp^-1 Npc over the cameras' and
/// poses' unknowns ("reduced"), whose inverse is Qcc; with Y = Npp^-1 Npc,
///   Qcp = -Qcc Y',   Qpp' = Npp^-1 [p = p'] + Y Qcc Y'.
/// All are a priori: times sigma0^2 they are a posteriori. Columns are scaled
/// to a unit diagonal before factoring.
class Dispersion {
 public:
  /// @throws AdjustmentError if N is singular (rank defect): names the unknowns
  ///     that the observations leave undetermined.
  explicit Dispersion(const Network& network);

  const UnknownIndex& index() const { return index_; }
  /// Covariance (U, U) of the reduced vector.
  const Eigen::MatrixXd& cov_reduced() const { return cov_; }
  /// Covariance of one point (zero where it is fixed).
  Eigen::Matrix3d CovPoint(int point) const;
  /// Covariance of all unknowns, reduced vector first, then the points'.
  Eigen::MatrixXd FullCovariance() const;

  /// Moves all unknowns of a network as the normal equations answer to a
  /// condition: the reduced unknowns `which` change by `change`, the others by
  /// Q[:, D] Q[D, D]^-1 change. `network` must have the values of the network
  /// that this dispersion was made of.
  void ApplyCondition(const std::vector<int>& which, const Eigen::VectorXd& change,
                      Network* network) const;

  /// Residual, w and redundancy of every observation, used or not.
  std::vector<ObservationStatistics> Statistics() const;
  /// Predicted picture of a point in an image and the covariance that the
  /// unknowns' covariance gives it; nullopt where there is none.
  struct Prediction {
    Eigen::Vector2d pixel;
    Eigen::Matrix2d cov_px2;
  };
  std::optional<Prediction> Predict(int image, int point) const;

  int num_observations() const { return num_observations_; }  ///< used image coordinates
  int num_prior() const { return num_prior_; }                ///< coordinates observed a priori
  int redundancy() const { return num_observations_ + num_prior_ - index_.num_unknowns(); }
  double weighted_squares() const { return weighted_squares_; }  ///< v'Pv, priors included
  /// v'Pv of the weighted points' coordinates and their redundancy.
  double point_squares() const { return point_squares_; }
  double point_redundancy() const { return point_redundancy_; }

 private:
  // An image point's derivatives by the unknowns that are estimated.
  struct Row {
    bool valid = false;
    int size = 0;
    std::array<int, 22> unknown;              // places in the reduced vector
    Eigen::Matrix<double, 2, 22> by_reduced;  // first `size` columns
    Eigen::Matrix<double, 2, 3> by_point;
    Eigen::Vector2d pixel;
  };
  Row Linearise(int image, int point) const;
  Eigen::Matrix2d CovOfPrediction(const Row& row, int point) const;
  void Accumulate();
  void AddPriors();
  void Factor();
  void AccountForPriors();
  [[noreturn]] void ThrowRankDefect(const Eigen::MatrixXd& normal) const;

  const Network& network_;
  UnknownIndex index_;
  Eigen::MatrixXd normal_;                     // Ncc
  Eigen::MatrixXd normal_by_point_;            // Ncp, (U, 3P)
  std::vector<Eigen::Matrix3d> normal_point_;  // Npp
  std::vector<Eigen::Matrix3d> inverse_point_;
  Eigen::MatrixXd y_;             // Y' = Ncp Npp^-1, (U, 3P)
  Eigen::MatrixXd cov_;           // Qcc
  Eigen::MatrixXd cov_by_point_;  // Qcp, (U, 3P)
  int num_observations_ = 0;
  int num_prior_ = 0;
  double weighted_squares_ = 0.0;
  double point_squares_ = 0.0;
  double point_redundancy_ = 0.0;
};

}  // namespace videogrammetry
