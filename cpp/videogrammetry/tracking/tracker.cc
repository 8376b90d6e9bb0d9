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
constexpr double kForget = 0.05;            // of the shares, a stage
constexpr double kFirstAcceleration = 0.1;  // of the spacing, until points have shown theirs
constexpr double kUnknown = 1e4;            // velocity of a point seen once, in spacings or 1 mm
constexpr int kLeastAround = 4;             // settled points that tell a new one's velocity
constexpr double kScaleGain = 0.1;          // of a track's process noise, by its misses
constexpr double kLargestScale = 4.6;       // log 100
constexpr double kCodeOdds = std::numeric_limits<double>::infinity();
constexpr double kNoLink = std::numeric_limits<double>::quiet_NaN();

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

// What the positions of the last stages say of the accelerations.
void Learn(TrackerState& s) {
  for (const int t : s.active) {
    const Track& track = s.track(t);
    if (track.row < 0 || track.dead || track.group >= 0) continue;
    const Track::Position *a = track.At(s.stage - 1), *b = track.At(s.stage - 2),
                          *c = track.At(s.stage - 3);
    if (!a || !b) continue;
    const auto r = static_cast<std::size_t>(track.row);
    const Eigen::Vector3d fourth = c ? c->position_mm : Eigen::Vector3d::Zero();
    s.statistics.Add(
        {s.rows.position_mm[r], a->position_mm, b->position_mm, fourth},
        {s.rows.variance_mm2[r], a->variance_mm2, b->variance_mm2, c ? c->variance_mm2 : 0.0},
        c != nullptr);
  }
  s.statistics.Commit();
}

// A prediction that was missed by more than the gate had too small a covariance;
// of a point seen once, any.
void Filter(TrackerState& s, Track& track) {
  const auto row = static_cast<std::size_t>(track.row);
  const Eigen::Vector3d& z = s.rows.position_mm[row];
  const Eigen::Matrix3d& cov = s.rows.cov_mm2[row];
  const MotionModel model = s.statistics.model();
  const MotionState& predicted = track.predicted;
  const double d2 =
      Compare(z - predicted.position_mm(), predicted.position_cov_mm2() + cov).distance2;
  const Track::Position* last = track.At(track.last_seen);
  const double gap = s.stage - track.last_seen;
  if (!(d2 < s.options.gate_sigma * s.options.gate_sigma) && last) {
    const Eigen::Vector3d velocity = (z - last->position_mm) / gap;
    const double var = (s.rows.variance_mm2[row] + last->variance_mm2) / (gap * gap) +
                       model.acceleration_var * gap * gap / 4.0;
    track.state = StartState(z, cov, velocity, var * Eigen::Matrix3d::Identity(), model);
    track.state.cov.block<3, 3>(0, 3) = cov / gap;
    track.state.cov.block<3, 3>(3, 0) = cov / gap;
    return;
  }
  // Points differ in how evenly they move: the covariance is led to what its misses show.
  if (track.settled && track.own_motion) {
    track.log_scale = std::clamp(track.log_scale + kScaleGain * (std::min(d2, 27.0) / 3.0 - 1.0),
                                 -kLargestScale, kLargestScale);
  }
  track.state = Update(predicted, z, cov);
}

void FinishTracks(TrackerState& s) {
  BodyMotions bodies(s);
  int expected = 0, found = 0;
  for (const int t : s.active) {
    Track& track = s.track(t);
    if (track.dead) continue;
    if (track.settled && track.last_seen >= s.stage - 3) {
      ++expected;
      found += track.row >= 0;
    }
    if (track.row >= 0) {
      if (track.group < 0) Filter(s, track);
      const auto row = static_cast<std::size_t>(track.row);
      track.settled = track.settled || track.hits > 0;
      ++track.hits;
      track.last_seen = s.stage;
      track.seen |= 1;
      track.Remember({s.stage, track.row, s.rows.position_mm[row], s.rows.variance_mm2[row]});
      continue;
    }
    if (track.group >= 0) continue;
    // A point that is not seen goes with the body, if that tells more than its own motion.
    const double own = track.predicted.position_cov_mm2().trace() / 3.0;
    const double good = kOwnMotionGood * s.spacing_mm;
    if (track.own_motion && own > std::max(good * good, 4.0 * s.rows.largest_variance_mm2) &&
        bodies.Rigid()) {
      const NeighbourMotion* motion = bodies.Since(track);
      if (motion && motion->rigid()) {
        const NeighbourMotion::Place place = bodies.Move(*motion, track);
        if (place.variance_mm2 < own) s.Carry(track, place);
      }
    }
    track.state = track.predicted;
    const int gap = s.stage - track.last_seen;
    if (track.number < s.first_free_id) continue;
    // Beyond the memory a point is found by its state or not at all.
    track.dead =
        gap >= s.options.max_gap_stages || (gap >= kMemoryStages && !s.CanBeFound(track.predicted));
  }
  if (expected > 0) {
    s.share_seen += kForget * (static_cast<double>(found) / expected - s.share_seen);
    s.share_seen = std::clamp(s.share_seen, 0.5, 0.995);
  }
}

// A new point's velocity: that of the settled points around it, or nothing.
void BeginTracks(TrackerState& s) {
  std::vector<int> fresh, settled;
  for (std::size_t r = 0; r < s.rows.size(); ++r) {
    if (s.rows.track[r] < 0) fresh.push_back(static_cast<int>(r));
  }
  if (s.rows.size() > 0 && s.stage > 0) {
    const double share = static_cast<double>(fresh.size()) / static_cast<double>(s.rows.size());
    s.share_new += kForget * (share - s.share_new);
    s.share_new = std::clamp(s.share_new, 1e-3, 0.3);
  }
  if (fresh.empty()) return;
  std::vector<Eigen::Vector3d> places;
  for (const int t : s.active) {
    if (!s.track(t).settled || s.track(t).dead || s.track(t).hits < 3) continue;
    settled.push_back(t);
    places.push_back(s.track(t).state.position_mm());
  }
  const PointIndex index(places);
  std::vector<PointIndex::Neighbour> around;
  const double unknown = kUnknown * std::max(s.spacing_mm, 1.0);
  for (const int r : fresh) {
    const auto row = static_cast<std::size_t>(r);
    index.Nearest(s.rows.position_mm[row], s.options.neighbours,
                  std::numeric_limits<double>::infinity(), &around);
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
    double variance = unknown * unknown;
    const bool informed = std::ssize(around) >= kLeastAround;
    if (!around.empty()) {
      const double n = static_cast<double>(around.size());
      double squares = 0.0, own = 0.0;
      for (const auto& a : around) {
        velocity += s.track(settled[static_cast<std::size_t>(a.index)]).state.velocity_mm() / n;
      }
      for (const auto& a : around) {
        const MotionState& state = s.track(settled[static_cast<std::size_t>(a.index)]).state;
        squares += (state.velocity_mm() - velocity).squaredNorm() / 3.0;
        own += state.cov.block<3, 3>(3, 3).trace() / 3.0 / n;
      }
      if (informed) variance = squares / (n - 1.0) * (1.0 + 1.0 / n) + own;
    }
    const int number = s.rows.id[row] >= 0 ? s.rows.id[row] : s.next_id++;
    const int t = s.NewTrack(number);
    Track& track = s.track(t);
    track.state = StartState(s.rows.position_mm[row], s.rows.cov_mm2[row], velocity,
                             variance * Eigen::Matrix3d::Identity(), s.statistics.model());
    track.informed = informed;
    track.hits = 1;
    track.first_seen = track.last_seen = s.stage;
    track.seen = 1;
    track.Remember({s.stage, r, s.rows.position_mm[row], s.rows.variance_mm2[row]});
    s.Give(t, r, kNoLink);
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

bool TrackerState::CanBeFound(const MotionState& predicted) const {
  return LinkConstant() +
             Compare(Eigen::Vector3d::Zero(), predicted.position_cov_mm2()).log_density >
         0;
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

void NameByCode(TrackerState& s) {
  std::vector<int> coded;
  std::vector<Eigen::Vector3d> places, loose_places;
  for (std::size_t r = 0; r < s.rows.size(); ++r) {
    if (s.rows.id[r] < 0) continue;
    coded.push_back(static_cast<int>(r));
    places.push_back(s.rows.position_mm[r]);
  }
  std::vector<int> loose;
  for (const int t : s.active) {
    const Track& track = s.track(t);
    if (track.row < 0 && !track.dead && track.group < 0 && track.number >= s.first_free_id)
      loose.push_back(t);
  }
  if (coded.empty() || loose.empty()) return;
  const PointIndex index(places);
  BodyMotions bodies(s);
  std::vector<double> reach;
  for (const int t : loose) {
    const Track& track = s.track(t);
    const NeighbourMotion* motion = bodies.Since(track);
    std::optional<NeighbourMotion::Place> place;
    if (motion) place = bodies.Move(*motion, track);
    loose_places.push_back(place ? place->position_mm : track.predicted.position_mm());
    const double variance =
        place ? place->variance_mm2 : track.predicted.position_cov_mm2().trace() / 3.0;
    reach.push_back(place || track.settled
                        ? s.options.gate_sigma *
                              std::sqrt(3.0 * (variance + s.rows.largest_variance_mm2))
                        : std::numeric_limits<double>::infinity());
  }
  const PointIndex loose_index(loose_places);
  std::vector<PointIndex::Neighbour> found;
  for (std::size_t k = 0; k < loose.size(); ++k) {
    const double limit = std::min(reach[k], s.options.max_share_of_spacing *
                                                std::min(s.rows.index.Distance(loose_places[k], 2),
                                                         loose_index.Distance(loose_places[k], 2)));
    index.Nearest(loose_places[k], 1, limit, &found);
    if (found.empty()) continue;
    const int row = coded[static_cast<std::size_t>(found[0].index)];
    const int holder = s.rows.track[static_cast<std::size_t>(row)];
    Track& track = s.track(loose[k]);
    if (holder >= 0) {
      const Track& other = s.track(holder);
      const bool beside = (other.seen & track.seen) != 0 || other.group >= 0;
      const bool forgotten = other.first_seen < s.stage - 63 &&
                             other.last_seen >= track.first_seen && track.first_seen < s.stage - 63;
      if (beside || forgotten) continue;  // seen side by side: two points
      track.first_seen = std::min(track.first_seen, other.first_seen);
      track.hits += other.hits;
      track.seen |= other.seen;
      s.track(holder).dead = true;
      s.track(holder).row = -1;
    }
    s.Rename(loose[k], track.number, s.rows.id[static_cast<std::size_t>(row)]);
    s.Give(loose[k], row, kCodeOdds);
  }
}

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
