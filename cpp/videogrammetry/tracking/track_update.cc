// What becomes of the tracks when a stage is linked: they are filtered, carried on, begun.
#include <algorithm>
#include <cmath>
#include <limits>

#include "videogrammetry/tracking/tracker_state.h"

namespace videogrammetry {
namespace {

constexpr double kForget = 0.05;       // of the shares, a stage
constexpr int kLeastAround = 4;        // settled points that tell a new one's velocity
constexpr double kScaleGain = 0.1;     // of a track's process noise, by its misses
constexpr double kLargestScale = 4.6;  // log 100

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

}  // namespace

void Learn(TrackerState& s) {
  for (const int t : s.active) {
    const Track& track = s.track(t);
    if (track.row < 0 || track.dead) continue;
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
    if (track.settled && s.stage - track.last_seen > 1) {
      s.returns.Add(s.stage - track.last_seen, track.row >= 0);
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
    track.dead = gap >= s.options.max_gap_stages || (gap >= kMemoryStages && !s.CanBeFound(track));
  }
  s.returns.Commit();
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

}  // namespace videogrammetry
