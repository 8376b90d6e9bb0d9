#pragma once

#include <cstdint>
#include <span>
#include <unordered_set>
#include <vector>

#include "videogrammetry/matching/pairs.h"

namespace videogrammetry {

/// The logarithm of 2 pi; candidates of lower log odds than hopeless take no measurable part
/// in anything; a target that adds less than a sure gain may as well be another's; two pictures
/// that cover one another are one target with the merged share's probability.
inline constexpr double kLogTwoPi = 1.8378770664093453, kHopeless = -7.0, kSureGain = 5.0,
                        kMergedShare = 0.5;

/// Upper limit of chi2 with d degrees of freedom at the two-sided level of the
/// normal quantile z: Wilson-Hilferty (1931), good to a per cent here.
double ChiSquareLimit(int dof, double z);

/// A set of targets, at most one a camera, whose rays meet within the gate.
struct Candidate {
  std::vector<ViewTarget> used;  // cameras ascending
  int id = -1;
  PointEstimate point;
  double fixed_score = 0.0;    // what does not depend on the stage's statistics
  double surface_score = 0.0;  // evidence of the neighbours' surface
  double score = 0.0;          // log odds against "met by chance"
  double probability = 0.0;    // that just this set is a point's
  std::uint64_t in_view = 0;   // cameras without a target of it that would see it
  std::uint64_t covered = 0;   // those of them where another target's picture covers the place

  std::size_t size() const { return used.size(); }
  bool Contains(const Candidate& smaller) const;
};

/// What the scores need to know of a stage as a whole; estimated from it.
struct StageStatistics {
  double log_density = 0.0;      ///< points per mm^3
  std::vector<double> log_lone;  ///< a camera: targets of no match per unit of normalised picture
  /// Inverse of the points' covariance about their mean (their box); 0 = unknown.
  Eigen::Matrix3d box_information = Eigen::Matrix3d::Zero();
  Eigen::MatrixXd seen;  ///< (c, a): probability that c has a target of what a has one of

  /// Before anything is matched.
  static StageStatistics Start(const std::vector<CameraView>& cameras,
                               const std::vector<TargetView>& targets, double volume_mm3);
  /// log odds of a candidate, its surface's evidence included.
  double Score(const Candidate& candidate) const;
};

/// A target near to where a camera should see a point.
struct NearTarget {
  double distance2 = 0.0;  ///< in standard deviations, squared
  double log_det = 0.0;    ///< of the difference's covariance
  int target = -1;
};

/// Makes and scores candidates of one stage from sets of targets.
class CandidateMaker {
 public:
  CandidateMaker(const std::vector<CameraView>& cameras, const std::vector<TargetView>& targets,
                 std::span<const CameraTargets> data, const MatchingOptions& options,
                 const MatchEdits& edits);

  /// Adjusts and scores a set of targets; false if the rays do not meet within
  /// the gate, the sizes contradict, the IDs do or the user keeps two apart.
  /// `forced`: whatever the rays and sizes say. `known`: the set's point, if it has been
  /// adjusted. Without `look`, in_view and covered are left to Look.
  bool Make(std::span<const ViewTarget> used, Candidate* candidate, bool forced = false,
            const PointEstimate* known = nullptr, bool look = true) const;

  /// Which cameras would see it and do not, and where another target may be the reason.
  void Look(Candidate* candidate) const;
  /// The same where the cameras that would see it, and the places, are known.
  void LookAt(std::uint64_t in_view, std::span<const Eigen::Vector2d> place,
              Candidate* candidate) const;

  /// Adds to a candidate the free targets that are surely its own.
  void Grow(const FreeTargets& free, const StageStatistics& statistics, Candidate* candidate) const;

  /// Replaces `near` by the free targets of camera c about xy, the picture of a point with
  /// the derivatives `by` and the covariance `cov_mm2`; nearest first.
  void Near(const Eigen::Vector2d& xy, const Eigen::Matrix<double, 2, 3>& by,
            const Eigen::Matrix3d& cov_mm2, std::size_t c, int id, const FreeTargets& free,
            std::vector<NearTarget>* near) const;

  const std::vector<CameraView>& cameras() const { return cameras_; }
  const std::vector<TargetView>& targets() const { return targets_; }
  int IdOf(const ViewTarget& s) const {
    return data_[static_cast<std::size_t>(s.camera)].id[static_cast<std::size_t>(s.target)];
  }

 private:
  bool SizesAgree(const Candidate& candidate) const;
  bool InRange(const Candidate& candidate) const;
  bool KeptApart(std::span<const ViewTarget> used) const;

  const std::vector<CameraView>& cameras_;
  const std::vector<TargetView>& targets_;
  std::span<const CameraTargets> data_;
  const MatchingOptions& options_;
  std::unordered_set<std::uint64_t> apart_;
  std::vector<double> chi2_limit_;       // by degrees of freedom
  std::vector<double> usual_reach_;      // a camera, normalised: of all but the large ones
  std::vector<std::vector<int>> large_;  // a camera: targets that cover more than that
};

/// Of a set of targets; does not depend on their order.
std::uint64_t SetKey(std::span<const ViewTarget> used);
std::uint64_t SetKey(const ViewTarget& a, const ViewTarget& b);

}  // namespace videogrammetry
