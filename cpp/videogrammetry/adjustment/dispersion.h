#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "videogrammetry/adjustment/elimination.h"
#include "videogrammetry/adjustment/network.h"
#include "videogrammetry/adjustment/normal_equations.h"

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

/// The same of a scale bar.
struct BarStatistics {
  double residual_mm = 0.0;  ///< given - adjusted length
  double normalised = 0.0;
  double redundancy = 0.0;
};

/// The same of a point's a-priori position; zeros where there is none.
struct PointStatistics {
  bool valid = false;
  Eigen::Vector3d residual_mm = Eigen::Vector3d::Zero();  ///< a priori - adjusted
  Eigen::Vector3d normalised = Eigen::Vector3d::Zero();   ///< per coordinate
  /// Test of the three together, T = u' Q_u^-1 u with u = (P v) of the point,
  /// chi-square with three degrees of freedom, as the |w| of equal probability.
  double test = 0.0;
  double redundancy = 0.0;  ///< of the three together
};

/// A-priori dispersion of the unknowns of a network at its present values.
///
/// Normal equations N = A'PA with blocks eliminated (NormalEquations); with the
/// inverse Q_rr = S^-1 of the reduced ones and T = [I; -Y] (reduced; eliminated)
///   Q = T Q_rr T' + D,  D = N_bb^-1 of each eliminated block.            (1)
/// All are a priori: times sigma0^2 they are a posteriori. Columns are scaled
/// to a unit diagonal before factoring.
///
/// Of a free network (FreeDatumSize > 0) N has the null space G
/// (DatumNullSpace); S + C C' with C spanning G_r is regular, and the inner
/// constraints over all points, G_p' dx = 0, give by the S-transformation [1]
///   Q = (I - G H) Q' (I - G H)',  H = (G_p' G_p)^-1 G_p'.                  (2)
/// With (1), G = T G_r and M = D H' this is
///   Q = T Q_rr T' + D - G M' - M G'                                        (3)
/// with Q_rr transformed once by H Q'.
///
/// [1] W. Baarda, S-transformations and criterion matrices, 1973.
class Dispersion {
 public:
  /// @throws AdjustmentError if N is singular (rank defect): names the unknowns
  ///     that the observations leave undetermined.
  explicit Dispersion(const Network& network, Elimination::What what = Elimination::What::kSmallest,
                      int num_threads = 0);
  // The normal equations refer to the elimination.
  Dispersion(const Dispersion&) = delete;
  Dispersion& operator=(const Dispersion&) = delete;

  const UnknownIndex& index() const { return index_; }
  /// Size of the vector that was factored.
  int num_reduced() const { return static_cast<int>(elimination_.reduced.size()); }
  /// Datum parameters that inner constraints determine.
  int datum_size() const { return static_cast<int>(null_space_.cols()); }

  /// Covariance between two sets of unknowns.
  Eigen::MatrixXd Covariance(const std::vector<int>& a, const std::vector<int>& b) const;
  /// Covariance of the cameras' and poses' unknowns, which come first.
  Eigen::MatrixXd CovOrientation() const;
  /// Covariance of one point: zero where it is fixed, NaN where it is starved.
  Eigen::Matrix3d CovPoint(int point) const;
  /// (3K, 3K) of some points.
  Eigen::MatrixXd CovPoints(const std::vector<int>& points) const;
  /// Covariance of all unknowns.
  Eigen::MatrixXd FullCovariance(int num_threads = 0) const;

  /// Moves all unknowns of a network as the normal equations answer to a
  /// condition: the unknowns `which` change by `change`, the others by
  /// Q[:, D] Q[D, D]^-1 change. `network` must have the values of the network
  /// that this dispersion was made of.
  void ApplyCondition(const std::vector<int>& which, const Eigen::VectorXd& change,
                      Network* network) const;

  /// Residual, w and redundancy of every observation, used or not.
  std::vector<ObservationStatistics> Statistics() const;
  /// Of every scale bar and of every point's a-priori position, used or not.
  std::vector<BarStatistics> StatisticsOfBars() const;
  std::vector<PointStatistics> StatisticsOfPoints() const;
  /// Predicted picture of a point in an image (at the nominal moment) and the covariance
  /// that the unknowns' covariance gives it; nullopt where there is none.
  struct Prediction {
    Eigen::Vector2d pixel;
    Eigen::Matrix2d cov_px2;
  };
  std::optional<Prediction> Predict(int image, int point) const;

  int num_observations() const { return normal_.num_observations; }  ///< used image coordinates
  /// A-priori coordinates and parameters, scale bars.
  int num_prior() const { return normal_.num_prior; }
  /// n - u + d: the inner constraints count as observations.
  int redundancy() const {
    return num_observations() + num_prior() + datum_size() - index_.num_unknowns;
  }
  double weighted_squares() const { return normal_.weighted_squares; }  ///< v'Pv, priors included
  /// v'Pv of the weighted points' coordinates, of the scale bars.
  double point_squares() const { return normal_.point_squares; }
  double bar_squares() const { return normal_.bar_squares; }

 private:
  void Invert(int num_threads);
  void ApplyDatum();
  void SpreadToBlocks(int num_threads);
  [[noreturn]] void ThrowRankDefect(const Eigen::VectorXd& scale) const;
  /// T of some unknowns over the reduced columns that they meet.
  Eigen::MatrixXd Expansion(const std::vector<int>& unknowns, std::vector<int>* columns) const;
  double CovOf(int a, int b) const;
  /// Covariance of some unknowns that one observation meets: blocks at hand.
  Eigen::MatrixXd CovOfMet(const int* unknown, int size) const;
  void OfWeightedPoint(int point, PointStatistics* s) const;
  void OfPriorBlock(std::vector<PointStatistics>* all) const;

  const Network& network_;
  UnknownIndex index_;
  Elimination elimination_;
  NormalEquations normal_;
  Eigen::MatrixXd cov_;            // Q_rr of (3)
  Eigen::VectorXd unit_diagonal_;  // of the scaled S
  Eigen::MatrixXd null_space_;     // G
  Eigen::MatrixXd datum_;          // M, zero for the reduced vector
  struct BlockCov {
    Eigen::MatrixXd own;         // Q_bb
    Eigen::MatrixXd by_columns;  // Q_br over the block's columns
  };
  std::vector<BlockCov> block_cov_;
};

}  // namespace videogrammetry
