#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

namespace videogrammetry {

/// Options of tracking.
struct LinkOptions {
  /// A prediction may be missed by this many of its standard deviations
  /// (Mahalanobis' distance; 5: a chance of 1.5e-5 for three coordinates). Range (0, 20].
  double gate_sigma = 5.0;
  /// What no covariance vouches for is linked within this share of the distance
  /// to the nearest other point. Range (0, 0.5).
  double max_share_of_spacing = 0.4;
  /// Where the object bends, this many points lie within the weight's reach. Range >= 3.
  int neighbours = 6;
  /// Links less sure than this (log odds against the best other assignment) are
  /// decided later, by what follows. Range >= 0.
  double min_log_odds = 9.0;
  /// Stages after which they are decided at last; 0: at once. Range [0, 15].
  int window_stages = 10;
  /// An un-coded point is given up after this many stages without it. Range >= 1.
  int max_gap_stages = 200;
};

/// All points numbered `from` so far, at all stages, are `to`.
struct Rename {
  int from = 0;
  int to = 0;
};

/// The point in `row` of stage `stage` (counted from 0) is `number`.
struct Revision {
  int stage = 0;
  int row = 0;
  int number = 0;
  double log_odds = 0.0;
};

/// What tracking says of a stage.
struct StageLinks {
  std::vector<int> number;  ///< of every point
  /// Of the link to the same point before, against the best assignment without
  /// it: infinite where a code says so, NaN where a number begins.
  std::vector<double> log_odds;
  std::vector<Rename> renames;      ///< of earlier stages, to be applied in this order
  std::vector<Revision> revisions;  ///< of the last `window_stages`, after the renames
};

struct TrackerState;

/// Numbers for points over stages, stage by stage: codes keep theirs, un-coded
/// points get numbers that stay.
///
/// Every point has a Kalman filter (MotionState) whose model is learnt from all
/// points (MotionStatistics). A stage is linked in steps:
///  1. by code;
///  2. by motion: log odds of a link against "missed and new",
///       log(P_seen / (1 - P_seen)) + log N(e; 0, S) - log(density of new points),
///     gated by chi-square, the likeliest assignment of all (AssignRows). Tracks are
///     predicted by their own motion or, where four points are identified, by
///     their neighbours' (NeighbourMotion), whichever has the smaller covariance;
///  3. where another assignment is nearly as likely, both are followed for a
///     window (HypothesisGroup; Reid, IEEE Trans. AC 24 (1979));
///  4. what remains, by the motion of all that is linked, from the identified
///     points outwards, within a share of the spacing; behind a gap only where that
///     is likelier than a new point by how often points return (ReturnStatistics);
///  5. an un-coded point where a code is read that has not been seen beside it is
///     that code, also before: a Rename;
///  6. points that nothing predicts yet, by four positions in a row that move evenly.
/// The rest begins a number. Points not seen are carried on, their covariance grows.
///
/// Memory: a state a point, the last 16 positions, `window_stages` stages of numbers.
class Tracker {
 public:
  /// @param first_free_id  first number of un-coded points, above the largest code.
  /// @throws std::invalid_argument if an option is out of range.
  explicit Tracker(int first_free_id, const LinkOptions& options = {});
  ~Tracker();
  Tracker(Tracker&&) noexcept;
  Tracker& operator=(Tracker&&) noexcept;

  /// The points of the next stage. A code that stands twice in the stage counts as not read.
  /// @param id  code or -1.
  /// @param cov_mm2  of the image noise.
  /// @throws std::invalid_argument if lengths differ, a number is not finite, an
  ///     id is not below first_free_id, or a variance is not positive. Nothing has
  ///     changed then.
  StageLinks Add(std::span<const int> id, std::span<const Eigen::Vector3d> position_mm,
                 std::span<const Eigen::Matrix3d> cov_mm2);

  /// Points whose states are kept, seen or not.
  std::size_t num_points() const;

 private:
  std::unique_ptr<TrackerState> state_;
};

}  // namespace videogrammetry
