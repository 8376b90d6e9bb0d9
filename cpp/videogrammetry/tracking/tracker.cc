#include "videogrammetry/tracking/tracker.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "videogrammetry/tracking/tracker_state.h"

namespace videogrammetry {
namespace {

constexpr int kSpacingEvery = 8;            // stages between two looks at the spacing
constexpr std::size_t kSpacingSample = 64;  // points that it is taken from
constexpr double kFirstAcceleration = 0.1;  // of the spacing, until points have shown theirs

void Check(const LinkOptions& o) {
  const auto refuse = [](const std::string& what) { throw std::invalid_argument(what); };
  if (!(o.gate_sigma > 0 && o.gate_sigma <= 20)) refuse("gate_sigma: expected (0, 20]");
  if (!(o.max_share_of_spacing > 0 && o.max_share_of_spacing < 0.5)) {
    refuse("max_share_of_spacing: expected (0, 0.5)");
  }
  if (o.neighbours < 3) refuse("neighbours: expected 3 or more");
  if (!(o.min_log_odds >= 0)) refuse("min_log_odds: expected 0 or more");
  if (o.window_stages < 0 || o.window_stages >= kMemoryStages) {
    refuse("window_stages: expected 0 to 15");
  }
  if (o.max_gap_stages < 1) refuse("max_gap_stages: expected 1 or more");
}

void CheckPoints(const TrackerState& s, std::span<const int> id,
                 std::span<const Eigen::Vector3d> position_mm,
                 std::span<const Eigen::Matrix3d> cov_mm2) {
  if (position_mm.size() != id.size() || cov_mm2.size() != id.size()) {
    throw std::invalid_argument("points: expected as many positions and covariances as ids");
  }
  for (std::size_t i = 0; i < id.size(); ++i) {
    const std::string where = "point " + std::to_string(i) + " of stage " + std::to_string(s.stage);
    if (id[i] >= s.first_free_id || id[i] < -1) {
      throw std::invalid_argument(where + ": id " + std::to_string(id[i]) +
                                  ", expected -1 or a code below the first free number " +
                                  std::to_string(s.first_free_id));
    }
    if (!position_mm[i].allFinite()) throw std::invalid_argument(where + ": position not finite");
    if (!cov_mm2[i].allFinite() || !(cov_mm2[i].diagonal().minCoeff() > 0) ||
        !(cov_mm2[i].determinant() > 0)) {
      throw std::invalid_argument(where + ": covariance not finite and positive");
    }
  }
}

void TakeRows(TrackerState& s, std::span<const int> id,
              std::span<const Eigen::Vector3d> position_mm,
              std::span<const Eigen::Matrix3d> cov_mm2) {
  StageRows& rows = s.rows;
  rows.stage = s.stage;
  rows.id.assign(id.begin(), id.end());
  rows.position_mm.assign(position_mm.begin(), position_mm.end());
  rows.cov_mm2.assign(cov_mm2.begin(), cov_mm2.end());
  rows.variance_mm2.clear();
  rows.largest_variance_mm2 = 0.0;
  for (const auto& cov : rows.cov_mm2) {
    rows.variance_mm2.push_back(cov.trace() / 3.0);
    rows.largest_variance_mm2 = std::max(rows.largest_variance_mm2, rows.variance_mm2.back());
  }
  rows.track.assign(rows.size(), -1);
  rows.index = PointIndex(rows.position_mm);
  // A code at two places was not read right at one of them at least.
  std::unordered_map<int, int> count;
  for (const int i : id) {
    if (i >= 0) ++count[i];
  }
  for (int& i : rows.id) {
    if (i >= 0 && count[i] > 1) i = -1;
  }
}

void LearnSpacing(TrackerState& s) {
  if (s.rows.size() < 2 || (s.spacing_mm > 0 && s.stage % kSpacingEvery != 0)) return;
  const std::size_t step = std::max<std::size_t>(1, s.rows.size() / kSpacingSample);
  std::vector<double> distance;
  for (std::size_t i = 0; i < s.rows.size(); i += step) {
    distance.push_back(s.rows.index.Distance(s.rows.position_mm[i], 2));
  }
  std::nth_element(distance.begin(), distance.begin() + std::ssize(distance) / 2, distance.end());
  s.spacing_mm = std::max(distance[distance.size() / 2], 6.0 * std::sqrt(s.rows.variance_mm2[0]));
  if (!s.statistics.prepared()) s.statistics = MotionStatistics(kFirstAcceleration * s.spacing_mm);
}

void LinkByCode(TrackerState& s) {
  for (std::size_t r = 0; r < s.rows.size(); ++r) {
    if (s.rows.id[r] < 0) continue;
    const auto found = s.track_of_number.find(s.rows.id[r]);
    if (found == s.track_of_number.end()) continue;
    s.Give(found->second, static_cast<int>(r), kCodeOdds);
  }
}

void SettleGroups(TrackerState& s) {
  for (HypothesisGroup& group : s.groups) {
    if (group.Settle(s)) {
      group.Release(s);
      group.members.clear();
    }
  }
  std::erase_if(s.groups, [](const HypothesisGroup& g) { return g.members.empty(); });
}

void RemoveDead(TrackerState& s) {
  std::erase_if(s.active, [&](int t) {
    Track& track = s.track(t);
    if (!track.dead) return false;
    if (const auto found = s.track_of_number.find(track.number);
        found != s.track_of_number.end() && found->second == t) {
      s.track_of_number.erase(found);
    }
    s.unused.push_back(t);
    return true;
  });
}

void Emit(TrackerState& s) {
  TrackerState::Past& now = s.PastOf(s.stage);
  now.number.assign(s.rows.size(), -1);
  now.row.clear();
  s.out.number.assign(s.rows.size(), -1);
  s.out.log_odds.assign(s.rows.size(), kNoLink);
  for (std::size_t r = 0; r < s.rows.size(); ++r) {
    const Track& track = s.track(s.rows.track[r]);
    s.out.number[r] = now.number[r] = track.number;
    s.out.log_odds[r] = track.log_odds;
    now.row.push_back(
        {s.stage, static_cast<int>(r), s.rows.position_mm[r], s.rows.variance_mm2[r]});
  }
}

}  // namespace

Tracker::Tracker(int first_free_id, const LinkOptions& options)
    : state_(std::make_unique<TrackerState>()) {
  if (first_free_id < 0) throw std::invalid_argument("first_free_id: expected 0 or more");
  Check(options);
  state_->first_free_id = state_->next_id = first_free_id;
  state_->options = options;
}

Tracker::~Tracker() = default;
Tracker::Tracker(Tracker&&) noexcept = default;
Tracker& Tracker::operator=(Tracker&&) noexcept = default;

std::size_t Tracker::num_points() const { return state_->active.size(); }

StageLinks Tracker::Add(std::span<const int> id, std::span<const Eigen::Vector3d> position_mm,
                        std::span<const Eigen::Matrix3d> cov_mm2) {
  TrackerState& s = *state_;
  CheckPoints(s, id, position_mm, cov_mm2);
  s.out = {};
  TakeRows(s, id, position_mm, cov_mm2);
  LearnSpacing(s);
  for (const int t : s.active) {
    Track& track = s.track(t);
    track.predicted = Predict(track.state, s.ModelOf(track));
    track.own_motion = true;
    track.row = -1;
    track.seen <<= 1;
  }
  LinkByCode(s);
  PredictByNeighbours(s);
  LinkByMotion(s);
  LinkByNeighbours(s);
  NameByCode(s);
  StartChains(s);
  Learn(s);
  FinishTracks(s);
  ExtendBack(s);
  BeginTracks(s);
  Emit(s);
  SettleGroups(s);
  RemoveDead(s);
  ++s.stage;
  return std::move(s.out);
}

}  // namespace videogrammetry
