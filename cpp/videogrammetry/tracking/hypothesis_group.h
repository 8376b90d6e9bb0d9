#pragma once

#include <vector>

#include "videogrammetry/tracking/motion_state.h"

namespace videogrammetry {

struct TrackerState;

/// Tracks whose links are not sure yet, with all histories of them that are
/// still likely (worlds). Each stage every world is continued by all likely
/// assignments; worlds less likely than the best by more than kForget in log
/// odds are given up, and so are, after the window, those that differ from the
/// best at its beginning.
struct HypothesisGroup {
  struct World {
    double weight = 0.0;  // log likelihood, against all missed and new
    std::vector<MotionState> state;
    std::vector<MotionState> predicted;  // at the stage that is being linked; empty: not yet
    std::vector<char> alive;             // a member that another member's rows explain is not there
    std::vector<std::vector<int>> rows;  // stage since first_stage, member -> row or -1
  };
  static constexpr std::size_t kMostMembers = 6, kMostWorlds = 24;
  static constexpr double kForget = 14.0;

  std::vector<int> members;   // tracks
  std::vector<World> worlds;  // the likeliest first
  int first_stage = 0;

  /// A group of one track before the current stage.
  static HypothesisGroup Of(TrackerState& s, int track);
  /// Both as one.
  static HypothesisGroup Join(const HypothesisGroup& a, const HypothesisGroup& b);

  /// Rows that any member may have at the current stage.
  std::vector<int> PossibleRows(TrackerState& s);
  /// Continues all worlds with the rows of the current stage that nobody has.
  void Step(TrackerState& s);
  /// Tells the tracks what the best world says and revises what was said otherwise.
  void Publish(TrackerState& s);
  /// Predicts all worlds to the current stage, once.
  void PredictWorlds(TrackerState& s);
  /// Whether all worlds agree, or the window is over; keeps the best then.
  bool Settle(const TrackerState& s);
  /// Gives the members back; those that the best world does not have are dead.
  void Release(TrackerState& s);
};

}  // namespace videogrammetry
