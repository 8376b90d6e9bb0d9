#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "videogrammetry/geometry/intersection.h"

namespace videogrammetry {

/// The targets of one camera's picture of a stage.
struct CameraTargets {
  std::vector<Eigen::Vector2d> xy_px;
  std::vector<Eigen::Matrix2d> cov_px2;  ///< image noise and what the calibration leaves open
  std::vector<int> id;                   ///< code number, -1 = un-coded
  std::vector<double> semi_major_px;     ///< <= 0 where unknown

  std::size_t size() const { return xy_px.size(); }
};

/// One camera's target of a point.
struct ViewTarget {
  int camera = 0, target = 0;
};

/// What the user has decided about targets of one stage.
struct MatchEdits {
  /// Sets of targets, at most one a camera, that are one point whatever their rays say.
  std::vector<std::vector<ViewTarget>> together;
  /// Pairs of targets that are not of one point.
  std::vector<std::pair<ViewTarget, ViewTarget>> apart;
};

/// Options of matching. "Near" is decided by covariances, never by a fixed
/// number of pixels.
struct MatchingOptions {
  /// Gate of the rays' distance in standard deviations (two-sided 1e-4).
  /// Range (0, 20].
  double critical_value = 3.89;
  /// A true dot's size times depth agrees between the cameras: larger ratios
  /// are no candidates. Range > 1; 0 = do not look at sizes.
  double max_size_ratio = 1.35;
  /// Least log odds that a match's targets are of one point (4.6: 100 to 1);
  /// below, they are reported ambiguous. Range >= 0.
  double min_log_odds = 4.6;
  /// Neighbours that predict a target's depth on its surface; 0 = none.
  int neighbours = 8;
  /// Points nearer or farther than this from any camera are no candidates, in
  /// mm; 0 = no limit.
  double min_distance_mm = 0.0;
  double max_distance_mm = 0.0;
  /// Threads of the search in one stage; 0: one a core. The result does not depend on it.
  int num_threads = 1;
};

/// What became of a target.
enum class TargetMatch : std::uint8_t {
  kMatched = 0,
  kNoPartner,       ///< no target of another camera within the gate
  kAmbiguous,       ///< two or more partners that nothing decides between
  kInconsistentId,  ///< the same ID elsewhere, but the rays do not meet
  kOutvoted         ///< its candidates belong, more surely, to other targets
};

/// Targets of two or more cameras that show one point.
struct Match {
  std::vector<int> target;  ///< one a camera: index or -1
  int id = -1;              ///< code number or -1
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  double chi2 = 0.0;               ///< of the rays' intersection, 2n - 3 degrees of freedom
  double log_odds = 0.0;           ///< that all its targets are of one point, against all else
  double false_probability = 0.0;  ///< 1 / (1 + exp(log_odds)); 0 of what the user has put together
};

struct MatchResult {
  std::vector<Match> matches;
  std::vector<std::vector<TargetMatch>> status;  ///< a camera, a target
};

/// Matches the targets of all cameras of one stage.
///
/// Coded targets by their ID, kept only where their rays meet. All others as the
/// most credible explanation of all pictures at once. Points are a Poisson
/// process of density rho in space; a camera in view has a target of each with
/// probability q; its targets of no match are one of density lambda_c. A set S of
/// n targets that are one point's then has, against "each is a target of no
/// match", the log odds
///   s(S) = log rho + 3/2 log 2 pi + 1/2 log |C| - chi2/2
///          + sum_{c in S} [log q_c - log 2 pi - 1/2 log |Sigma_c| - log lambda_c]
///          + sum_{c not in S, in view} log(1 - q_c),
/// the integral over the point's place by Laplace's method, C its covariance. In
/// the last sum, where another target's picture covers the place, 1 - q_c
/// becomes 1 - q_c / 2: two pictures may have merged. rho, q (camera by camera)
/// and lambda_c are estimated from the stage itself by expectation maximisation.
/// Where the points span a surface, the neighbours' evidence is added (inverse
/// depth is affine in the picture of a plane).
///
/// Compatible sets have the probability exp(sum s) / Z; a match's probability is
/// the sum over all those in which its targets are one point (SetProbabilities),
/// and it is kept if the odds are min_log_odds.
///
/// Sources: Cox, A review of statistical data association techniques for motion
/// correspondence, IJCV 10, 1993; Poore, Multidimensional assignment formulation
/// of data association problems, 1994.
///
/// @param edits  what the user has decided; it comes first.
/// @throws std::invalid_argument if the number of cameras differs or is above 64,
///     arrays differ in length, an option is out of range, or edits name a target
///     that is not there or twice, or one that cannot be intersected.
MatchResult MatchStage(const Rig& rig, std::span<const CameraTargets> cameras,
                       const MatchingOptions& options = {}, const MatchEdits& edits = {});

}  // namespace videogrammetry
