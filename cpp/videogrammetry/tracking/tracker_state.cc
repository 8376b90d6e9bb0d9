#include "videogrammetry/tracking/tracker_state.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace videogrammetry {

MotionModel TrackerState::ModelOf(const Track& t) const {
  MotionModel model = statistics.model();
  model.acceleration_var *= std::exp(t.log_scale);
  return model;
}

int TrackerState::NewTrack(int number) {
  int t = static_cast<int>(tracks.size());
  if (unused.empty()) {
    tracks.emplace_back();
  } else {
    t = unused.back();
    unused.pop_back();
    track(t) = Track{};
  }
  track(t).number = number;
  active.push_back(t);
  track_of_number[number] = t;
  return t;
}

void TrackerState::Give(int t, int row, double log_odds) {
  track(t).row = row;
  track(t).log_odds = log_odds;
  rows.track[static_cast<std::size_t>(row)] = t;
}

void TrackerState::Rename(int t, int from, int to) {
  out.renames.push_back({from, to});
  for (Past& stage_before : past) {
    std::replace(stage_before.number.begin(), stage_before.number.end(), from, to);
  }
  for (Revision& r : out.revisions) {  // they are applied after the renames
    if (r.number == from) r.number = to;
  }
  track_of_number.erase(from);
  track(t).number = to;
  track_of_number[to] = t;
}

void TrackerState::Revise(int at_stage, int row, int number, double log_odds) {
  PastOf(at_stage).number[static_cast<std::size_t>(row)] = number;
  out.revisions.push_back({at_stage, row, number, log_odds});
}

void TrackerState::Carry(Track& t, const NeighbourMotion::Place& place) {
  const Track::Position* last = t.At(t.last_seen);
  const double gap = last ? stage - t.last_seen : 1;
  const Eigen::Vector3d from = last ? last->position_mm : t.state.position_mm();
  const Eigen::Matrix3d unit = Eigen::Matrix3d::Identity();
  const MotionModel model = statistics.model();
  t.predicted =
      StartState(place.position_mm, place.variance_mm2 * unit, (place.position_mm - from) / gap,
                 (2.0 * place.variance_mm2 / (gap * gap) + model.acceleration_var) * unit, model);
}

double TrackerState::LinkConstant() const {
  const double spacing = spacing_mm > 0 ? spacing_mm : kUnknown;
  return std::log(share_seen / (1.0 - share_seen)) - std::log(share_new) + 3.0 * std::log(spacing);
}

double TrackerState::LogOdds(const MotionState& predicted, std::size_t row) const {
  const Innovation e = Compare(rows.position_mm[row] - predicted.position_mm(),
                               predicted.position_cov_mm2() + rows.cov_mm2[row]);
  if (!(e.distance2 <= options.gate_sigma * options.gate_sigma)) {
    return -std::numeric_limits<double>::infinity();
  }
  return LinkConstant() + e.log_density;
}

double TrackerState::ReturnOdds(const Track& t) const {
  if (t.last_seen >= stage - 1) return 0.0;
  return returns.LogOdds(stage - t.last_seen) - std::log(share_seen / (1.0 - share_seen));
}

bool TrackerState::CanBeFound(const Track& t) const {
  return LinkConstant() + ReturnOdds(t) +
             Compare(Eigen::Vector3d::Zero(), t.predicted.position_cov_mm2()).log_density >
         (t.last_seen < stage - 1 ? kLeastAfterGap : 0.0);
}

void TrackerState::Candidates(const MotionState& predicted, int most,
                              std::vector<int>* rows_found) const {
  thread_local std::vector<PointIndex::Neighbour> found;
  const double reach = options.gate_sigma * std::sqrt(predicted.position_cov_mm2().trace() +
                                                      3.0 * rows.largest_variance_mm2);
  rows.index.Nearest(predicted.position_mm(), most, reach, &found);
  rows_found->clear();
  for (const auto& f : found) rows_found->push_back(f.index);
}

}  // namespace videogrammetry
