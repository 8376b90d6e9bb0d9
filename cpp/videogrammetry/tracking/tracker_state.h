#pragma once

// What the parts of the tracker share; not for other rooms.

#include <array>
#include <cstdint>
#include <deque>
#include <limits>
#include <map>
#include <optional>
#include <unordered_map>
#include <vector>

#include "videogrammetry/tracking/hypothesis_group.h"
#include "videogrammetry/tracking/motion_state.h"
#include "videogrammetry/tracking/motion_statistics.h"
#include "videogrammetry/tracking/neighbour_motion.h"
#include "videogrammetry/tracking/point_index.h"
#include "videogrammetry/tracking/return_statistics.h"
#include "videogrammetry/tracking/tracker.h"

namespace videogrammetry {

constexpr int kMemoryStages = 16;  // positions kept of every point; more than any window

// Deviation of a prediction, of the spacing, below which no neighbours are asked.
constexpr double kOwnMotionGood = 0.05;

constexpr double kLeastAfterGap = 4.6;  // log odds of a link behind a gap
constexpr double kUnknown = 1e4;        // velocity of a point seen once, in spacings or 1 mm

constexpr double kCodeOdds = std::numeric_limits<double>::infinity();
constexpr double kNoLink = std::numeric_limits<double>::quiet_NaN();

struct Track {
  int number = 0;
  MotionState state;       // after the last stage
  MotionState predicted;   // at the stage that is being linked
  bool own_motion = true;  // whether the prediction is the filter's
  int hits = 0, first_seen = 0, last_seen = -1;
  bool settled = false;   // its velocity is known: linked at least once
  bool informed = false;  // its velocity is guessed from the points around it
  bool dead = false;
  int group = -1;
  double log_scale = 0.0;  // of the process noise against that of all points
  int row = -1;            // at the stage that is being linked
  double log_odds = 0.0;
  std::uint64_t seen = 0;  // bit k: seen k stages ago

  struct Position {
    int stage = -1, row = -1;
    Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
    double variance_mm2 = 0.0;
  };
  std::array<Position, kMemoryStages> past;

  const Position* At(int stage) const {
    if (stage < 0) return nullptr;
    const Position& p = past[static_cast<std::size_t>(stage % kMemoryStages)];
    return p.stage == stage ? &p : nullptr;
  }
  void Remember(const Position& p) { past[static_cast<std::size_t>(p.stage % kMemoryStages)] = p; }
};

inline bool Loose(const Track& track) { return track.row < 0 && track.group < 0 && !track.dead; }

// The stage that is being linked.
struct StageRows {
  int stage = 0;
  std::vector<int> id;
  std::vector<Eigen::Vector3d> position_mm;
  std::vector<Eigen::Matrix3d> cov_mm2;
  std::vector<double> variance_mm2;  // a coordinate
  std::vector<int> track;            // who has it, -1
  PointIndex index;
  double largest_variance_mm2 = 0.0;

  std::size_t size() const { return id.size(); }
  /// Neither linked nor coded: codes are linked by their number alone.
  bool IsOpen(int row) const {
    const auto r = static_cast<std::size_t>(row);
    return track[r] < 0 && id[r] < 0;
  }
};

struct TrackerState {
  int first_free_id = 0, next_id = 0;
  LinkOptions options;
  int stage = 0;
  MotionStatistics statistics;
  double spacing_mm = 0.0;   // median distance to the nearest other point; 0: not known
  double share_seen = 0.95;  // of the points that were to be seen
  double share_new = 0.05;   // of a stage's points
  ReturnStatistics returns;  // of points that were not seen
  std::deque<Track> tracks;  // places are used again
  std::vector<int> active;   // in the order of their beginning
  std::vector<int> unused;
  std::unordered_map<int, int> track_of_number;
  std::vector<HypothesisGroup> groups;
  struct Past {  // a stage before this one
    std::vector<int> number;
    std::vector<Track::Position> row;
  };
  std::vector<Past> past = std::vector<Past>(kMemoryStages);
  StageRows rows;
  StageLinks out;

  MotionModel ModelOf(const Track& t) const;
  Track& track(int i) { return tracks[static_cast<std::size_t>(i)]; }
  int NewTrack(int number);
  void Give(int t, int row, double log_odds);  // links a row to a track, without an update
  /// The prediction of a track whose neighbours tell where it is.
  void Carry(Track& track, const NeighbourMotion::Place& place);
  /// All that was `from` is `to`, which is the track's number.
  void Rename(int t, int from, int to);
  void Revise(int at_stage, int row, int number, double log_odds);
  Past& PastOf(int at_stage) { return past[static_cast<std::size_t>(at_stage % kMemoryStages)]; }

  double LinkConstant() const;  // log odds of a link without log N(e; 0, S)
  double LogOdds(const MotionState& predicted, std::size_t row) const;  // -inf outside the gate
  /// What is added to the log odds of a link for the stages in which the track was not seen.
  double ReturnOdds(const Track& track) const;
  /// Whether a row at the very place would be a link.
  bool CanBeFound(const Track& track) const;
  /// The nearest rows within the gate's reach.
  void Candidates(const MotionState& predicted, int most, std::vector<int>* rows_found) const;
};

// Bodies' motions to the current stage by the stage before, from what is linked so far.
class BodyMotions {
 public:
  explicit BodyMotions(TrackerState& s) : s_(s) {}
  /// The motion since the track was seen last; null if too few are identified at both stages.
  const NeighbourMotion* Since(const Track& track);
  /// Whether the last stage's motion is rigid; over more stages it is not, where it is not over
  /// one.
  bool Rigid();
  /// Where that puts the track.
  NeighbourMotion::Place Move(const NeighbourMotion& motion, const Track& track) const;
  /// The same by Since, once a track; none if too few are identified.
  const std::optional<NeighbourMotion::Place>& PlaceOf(int track);
  /// Forgets what was found if by far more is linked since.
  void Refresh();

 private:
  const NeighbourMotion* From(int stage);

  TrackerState& s_;
  std::map<int, std::optional<NeighbourMotion>> from_;
  std::unordered_map<int, std::optional<NeighbourMotion::Place>> place_of_;
  int linked_ = -1;
};

// The steps of a stage, in their order.
void PredictByNeighbours(TrackerState& s);
void LinkByMotion(TrackerState& s);
void LinkByNeighbours(TrackerState& s);
void NameByCode(TrackerState& s);
void StartChains(TrackerState& s);
void Learn(TrackerState& s);  // what the last stages' positions say of the accelerations
void FinishTracks(TrackerState& s);
void ExtendBack(TrackerState& s);
void BeginTracks(TrackerState& s);

}  // namespace videogrammetry
