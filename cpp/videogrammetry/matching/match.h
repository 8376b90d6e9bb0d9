#pragma once

#include <cstdint>
#include <span>
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

/// Options of matching. "Near" is decided by covariances, never by a fixed
/// number of pixels.
struct MatchingOptions {
  /// Gate of the rays' distance in standard deviations (two-sided 1e-4).
  /// Range (0, 20].
  double critical_value = 3.89;
  /// A true dot's size times depth agrees between the cameras: larger ratios
  /// are no candidates. Range > 1; 0 = do not look at sizes.
  double max_size_ratio = 1.35;
  /// Least log odds of a match against its best alternative, which may be that
  /// the targets only met by chance (4.6: 100 to 1); below, they are reported
  /// ambiguous. Range >= 0.
  double min_log_odds = 4.6;
  /// Neighbours that predict a target's depth on its surface; 0 = none.
  int neighbours = 8;
  /// Points nearer or farther than this from any camera are no candidates, in
  /// mm; 0 = no limit.
  double min_distance_mm = 0.0;
  double max_distance_mm = 0.0;
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
  double chi2 = 0.0;      ///< of the rays' intersection, 2n - 3 degrees of freedom
  double log_odds = 0.0;  ///< against the best alternative; large where there is none
};

struct MatchResult {
  std::vector<Match> matches;
  std::vector<std::vector<TargetMatch>> status;  ///< a camera, a target
};

/// Matches the targets of all cameras of one stage.
///
/// Coded targets by their ID, kept only where their rays meet. All others: every
/// pair within the epipolar gate is intersected and projected into the other
/// cameras; each resulting set of targets gets the log odds of "one point"
/// against "met by chance",
///   log prior odds - chi2/2 - (2n-3) log(sqrt(2 pi) s) - (n-1) log(density) - log(line length)
/// (n cameras, s the targets' standard deviation in px, density in targets per
/// px^2), plus the evidence of the surface that reliable neighbours span
/// (inverse depth is affine in the picture of a plane). The globally best set
/// of compatible matches is sought, and a match is kept if it is min_log_odds
/// better than what would replace it.
///
/// @throws std::invalid_argument if the number of cameras differs, arrays differ
///     in length, or an option is out of range.
MatchResult MatchStage(const Rig& rig, std::span<const CameraTargets> cameras,
                       const MatchingOptions& options = {});

}  // namespace videogrammetry
