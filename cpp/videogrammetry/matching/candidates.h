#pragma once

#include <cstdint>
#include <span>
#include <unordered_set>
#include <vector>

#include "videogrammetry/matching/view.h"

namespace videogrammetry {

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

/// Finds and scores sets of targets of one stage.
class CandidateFinder {
 public:
  CandidateFinder(const std::vector<CameraView>& cameras, const std::vector<TargetView>& targets,
                  std::span<const CameraTargets> data, const MatchingOptions& options,
                  const MatchEdits& edits);

  /// Volume of the space from which the rays come, from pairs that pass the gate.
  double PairVolume(const std::vector<std::vector<char>>& free);

  /// All candidates among the targets that `free` marks (a camera, a target)
  /// whose score is not hopeless.
  std::vector<Candidate> Find(const std::vector<std::vector<char>>& free,
                              const StageStatistics& statistics);

  /// Adjusts and scores a set of targets; false if the rays do not meet within
  /// the gate, the sizes contradict, the IDs do or the user keeps two apart.
  /// `forced`: whatever the rays and sizes say.
  bool Make(std::span<const ViewTarget> used, Candidate* candidate, bool forced = false) const;

  /// Adds to a candidate the free targets that are surely its own.
  void Grow(const std::vector<std::vector<char>>& free, const StageStatistics& statistics,
            Candidate* candidate) const;

 private:
  struct Hypothesis {
    std::vector<ViewTarget> used;
    PointEstimate point;
    double score = 0.0;
    int missed = 0;
  };
  struct Near {
    double distance2;
    double log_det;
    int target;
  };

  template <typename Function>
  void ForPairs(std::size_t a, std::size_t b, const std::vector<std::vector<char>>& free,
                std::size_t every, Function f) const;
  bool PairPasses(std::size_t a, std::size_t i, std::size_t b, std::size_t j,
                  const Eigen::Matrix3d& essential) const;
  std::vector<Eigen::Vector2d> EpipolarCurve(std::size_t a, std::size_t i, std::size_t b) const;
  void Seed(std::size_t a, std::size_t i, std::size_t b, std::size_t j);
  void GrowFrom(Hypothesis hypothesis, std::size_t camera);
  void NearTargets(const PointEstimate& point, std::size_t c, int id,
                   const std::vector<std::vector<char>>& free, std::vector<Near>* near,
                   Eigen::Vector2d* xy, Eigen::Matrix<double, 2, 3>* by) const;
  void Emit(std::vector<ViewTarget> used);
  void AddParts();
  void Look(Candidate* candidate) const;
  bool SizesAgree(const Candidate& candidate) const;
  bool InRange(const Candidate& candidate) const;
  bool KeptApart(std::span<const ViewTarget> used) const;
  int IdOf(const ViewTarget& s) const {
    return data_[static_cast<std::size_t>(s.camera)].id[static_cast<std::size_t>(s.target)];
  }

  const std::vector<CameraView>& cameras_;
  const std::vector<TargetView>& targets_;
  std::span<const CameraTargets> data_;
  const MatchingOptions& options_;
  std::unordered_set<std::uint64_t> apart_;
  std::vector<double> chi2_limit_;  // by degrees of freedom
  std::vector<double> max_semi_;    // a camera, normalised
  // While finding:
  const std::vector<std::vector<char>>* free_ = nullptr;
  const StageStatistics* statistics_ = nullptr;
  std::vector<Candidate> found_;
  std::unordered_set<std::uint64_t> sets_, pairs_;
  std::vector<std::vector<char>> settled_;
  int leaves_ = 0;
};

}  // namespace videogrammetry
