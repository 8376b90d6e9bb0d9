#pragma once

#include <map>
#include <span>
#include <vector>

#include "videogrammetry/matching/stage_matcher.h"
#include "videogrammetry/matching/stages.h"
#include "videogrammetry/matching/tracks.h"

namespace videogrammetry {

/// Matches the stages of a chunk in order, then backwards (see MatchStages).
class Chunk {
 public:
  Chunk(const Rig& rig, const std::vector<FlatTargets>& cameras, const MatchingOptions& options,
        const std::map<std::size_t, MatchEdits>& edits);

  StageMatches Run();

 private:
  struct Found {
    std::size_t stage, track;
    std::vector<ViewTarget> used;
    double chi2;
    Eigen::Vector3d position_mm;
    Eigen::Matrix3d cov_mm2;
  };

  static MatchingOptions Likely(MatchingOptions options);

  std::size_t Flat(const ViewTarget& s, std::size_t stage) const {
    return cameras_[static_cast<std::size_t>(s.camera)].offsets[stage] +
           static_cast<std::size_t>(s.target);
  }
  TargetMatch& Status(const ViewTarget& s, std::size_t stage) {
    return status_[static_cast<std::size_t>(s.camera)][Flat(s, stage)];
  }
  bool IsFree(const ViewTarget& s, std::size_t stage) {
    const TargetMatch status = Status(s, stage);
    return status != TargetMatch::kMatched && status != TargetMatch::kInconsistentId;
  }

  void LoadStage(std::size_t stage);

  void Forward(std::size_t stage);

  bool Alive(const TrackedPoint& track) const;

  // By ID: all of a stage's codes in one sorted list.
  void MatchCoded(std::size_t stage);

  // A code that is read once a camera and whose rays meet; all others are the search's.
  void OneCode(std::size_t stage, std::size_t first, std::size_t last);

  // Codes left over though another camera has read the same: their rays do not meet.
  void NameInconsistentCodes(std::size_t stage);

  const TargetView& View(const ViewTarget& s) const {
    return targets_[static_cast<std::size_t>(s.camera)];
  }
  static std::size_t Index(const ViewTarget& s) { return static_cast<std::size_t>(s.target); }

  // Valid rays that meet, with sizes that agree.
  bool RaysMeet(std::span<const ViewTarget> used, PointEstimate* point) const;

  bool SizesAgree(std::size_t stage, std::span<const ViewTarget> used,
                  const PointEstimate& point) const;

  void MatchPredicted(std::size_t stage);

  // The targets nearest to where a point is expected, if their rays meet: used_.
  bool FindPredicted(std::size_t stage, int id, const Eigen::Matrix3d& cov, PointEstimate* point,
                     double* gain);

  // used_, less those that do not fit; false if fewer than two are left.
  bool MeetWithoutWorst(std::size_t stage, PointEstimate* point);

  std::size_t NewTrack(int id, double log_odds);

  // A track's match of a stage: filter, list and status.
  void Follow(std::size_t stage, std::size_t t, const PointEstimate& point,
              const std::vector<ViewTarget>& used);

  void Note(std::size_t stage, std::size_t t, const PointEstimate& point,
            const std::vector<ViewTarget>& used);

  // The full search among what is free.
  void SearchRest(std::size_t stage, const MatchEdits* edits);

  void AddSearched(std::size_t stage, const MatchResult& result,
                   const std::vector<std::vector<int>>& place);

  // Which points of the stage before, without a velocity yet, go on in which match:
  // nearest to one another, nearer than the points are to each other.
  std::vector<std::size_t> Continued(std::size_t stage, const MatchResult& result,
                                     const std::vector<PointEstimate>& points) const;

  // Points to stages before the first at which they were found.
  void Backward();

  // From its third place to its first, so that the filter runs the other way.
  void BeginBackward(std::size_t t);

  StageMatches Result();

  struct Code {
    int id;
    ViewTarget place;
  };
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  const std::vector<FlatTargets>& cameras_;
  const MatchingOptions& options_;
  const std::map<std::size_t, MatchEdits>& edits_;
  StageMatcher search_;
  std::size_t num_cameras_, num_stages_ = 0;
  std::vector<CameraView> views_;
  std::vector<TargetView> targets_;
  std::vector<double> chi2_limit_;  // by degrees of freedom - 1
  std::vector<std::vector<TargetMatch>> status_;
  std::vector<TrackedPoint> tracks_;
  std::vector<std::size_t> alive_, order_;
  std::map<int, std::size_t> track_of_id_;
  std::vector<Found> found_;
  std::vector<Code> codes_;
  std::vector<ViewTarget> used_;
};

}  // namespace videogrammetry
