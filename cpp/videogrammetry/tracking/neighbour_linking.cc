// Links by the motion of all that is linked: tracker.h, step 4.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "videogrammetry/tracking/sparse_assignment.h"
#include "videogrammetry/tracking/tracker_state.h"

namespace videogrammetry {
namespace {

constexpr int kMostRows = 8;  // candidates of a track
constexpr int kMaxRounds = 6;
constexpr int kGuessed = 4;  // stages after which a point seen once is not guessed where it bends
constexpr int kBlowWithin = 2;   // stages not seen behind which a blow may have been
constexpr double kBlow = 2.0;    // times the velocity, what a blow adds
constexpr double kTold = 0.15;   // of the spacing: the neighbours' motion is worth following
constexpr double kFarOff = 3.0;  // spacings that bending may differ from a point's own motion
constexpr std::size_t kPopulation = 8;
constexpr double kChanceShare = 0.6;  // of the limit; by chance the median is 2^(-1/3) = 0.79

// A place that a loose track is expected at and how far from it it may be.
struct Expected {
  int track = 0;
  Eigen::Vector3d place_mm = Eigen::Vector3d::Zero();
  double limit_mm = 0.0;
  bool guessed = false;  // a point seen once, by nothing but its place
};

// How far from its own prediction a point may be behind a gap that no blow explains.
double ReachBehindGap(const TrackerState& s, const Track& track) {
  return s.options.max_share_of_spacing * s.spacing_mm +
         2.0 * s.options.gate_sigma * track.predicted.deviation_mm();
}

// Log odds of a link to a row anywhere within a limit, which no covariance vouches for.
double OddsWithin(const TrackerState& s, const Track& track, double limit_mm) {
  const double volume = 4.0 / 3.0 * std::numbers::pi * std::pow(limit_mm, 3);
  return s.LinkConstant() + s.ReturnOdds(track) - std::log(volume);
}

std::vector<Expected> Expect(TrackerState& s, const PointIndex& open, BodyMotions& bodies) {
  std::vector<Expected> expected;
  const double least_limit =
      s.options.gate_sigma * std::sqrt(6.0 * s.rows.largest_variance_mm2);  // noise at both ends
  for (const int t : s.active) {
    const Track& track = s.track(t);
    if (!Loose(track)) continue;
    bool told = false;  // by the points around
    Expected e{t, track.predicted.position_mm(), std::numeric_limits<double>::infinity(), false};
    // Bending is worked out for those alone that could have a row.
    const bool lost = track.settled && track.last_seen < s.stage - 1 - kBlowWithin;
    if (lost && OddsWithin(s, track, least_limit) < kLeastAfterGap) continue;
    const double off = open.Distance(e.place_mm, 1);
    if (lost && off > ReachBehindGap(s, track)) continue;
    const NeighbourMotion* motion = bodies.Since(track);
    if (motion && !motion->rigid() &&
        ((!track.settled && track.last_seen < s.stage - kGuessed) ||
         off > kFarOff * s.spacing_mm)) {
      continue;
    }
    if (const auto& place = bodies.PlaceOf(t)) {
      e.place_mm = place->position_mm;
      told = place->variance_mm2 < std::pow(kTold * s.spacing_mm, 2);
      const double noise = motion->rigid() ? s.rows.largest_variance_mm2 : 0.0;
      // Bending differs from place to place: while a point is watched, its
      // neighbours' agreement is no limit.
      if (motion->rigid() || track.last_seen < s.stage - 1 - kBlowWithin) {
        e.limit_mm = s.options.gate_sigma * std::sqrt(3.0 * (place->variance_mm2 + noise));
      }
    } else {
      e.guessed = !track.settled;
    }
    if (track.settled && track.own_motion && track.last_seen < s.stage - 1 && !told) {
      // A blow turns a velocity round at most; behind a long gap it is not looked for.
      double reach = 2.0 * s.options.gate_sigma * track.predicted.deviation_mm();
      if (track.last_seen >= s.stage - 1 - kBlowWithin) {
        reach += kBlow * track.state.velocity_mm().norm();
      }
      e.limit_mm = std::min(e.limit_mm, reach);
    }
    expected.push_back(e);
  }
  // What was lost before may be the same point as what was seen since.
  std::vector<Eigen::Vector3d> places;
  for (const Expected& e : expected) {
    if (s.track(e.track).last_seen == s.stage - 1) places.push_back(e.place_mm);
  }
  const PointIndex index(places);
  for (Expected& e : expected) {
    // The second nearest of either cloud is the nearest point that it could be taken for.
    const int self = s.track(e.track).last_seen == s.stage - 1 ? 1 : 0;
    const double spacing =
        std::min(s.rows.index.Distance(e.place_mm, 2), index.Distance(e.place_mm, 1 + self));
    e.limit_mm = std::min(e.limit_mm, s.options.max_share_of_spacing * spacing);
  }
  std::erase_if(expected, [&](const Expected& e) {
    const Track& track = s.track(e.track);
    if (track.last_seen == s.stage - 1 || std::isinf(e.limit_mm)) return false;
    return OddsWithin(s, track, e.limit_mm) < 0.0;
  });
  return expected;
}

// Whether points seen once lie no nearer to rows than chance has it.
bool ByChance(TrackerState& s, const std::vector<Expected>& expected) {
  const auto median = [](std::vector<double> values) {
    std::nth_element(values.begin(), values.begin() + std::ssize(values) / 2, values.end());
    return values[values.size() / 2];
  };
  std::vector<Eigen::Vector3d> steps;
  std::vector<double> limits, share;
  std::array<std::vector<double>, 3> each;
  std::vector<PointIndex::Neighbour> found;
  for (const Expected& e : expected) {
    if (!e.guessed) continue;
    s.rows.index.Nearest(e.place_mm, 1, e.limit_mm, &found);
    if (found.empty()) continue;
    steps.push_back(s.rows.position_mm[static_cast<std::size_t>(found[0].index)] - e.place_mm);
    limits.push_back(e.limit_mm);
    for (int k = 0; k < 3; ++k) each[static_cast<std::size_t>(k)].push_back(steps.back()[k]);
  }
  if (steps.size() < kPopulation) return false;
  // What all have in common is no chance.
  const Eigen::Vector3d common(median(each[0]), median(each[1]), median(each[2]));
  for (std::size_t i = 0; i < steps.size(); ++i)
    share.push_back((steps[i] - common).norm() / limits[i]);
  return median(share) > kChanceShare;
}

bool LinkExpected(TrackerState& s, const std::vector<Expected>& expected, bool with_guessed) {
  std::vector<LinkCandidate> candidates;
  std::vector<PointIndex::Neighbour> found;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const Expected& e = expected[i];
    if (e.guessed && !with_guessed) continue;
    s.rows.index.Nearest(e.place_mm, kMostRows, e.limit_mm, &found);
    for (const auto& f : found) {
      if (!s.rows.IsOpen(f.index)) continue;
      // As many as possible, and those near.
      const double share = std::isinf(e.limit_mm) ? 0.0 : std::sqrt(f.distance2) / e.limit_mm;
      candidates.push_back({static_cast<int>(i), f.index, 10.0 - share});
    }
  }
  const auto links = AssignRows(static_cast<int>(expected.size()), static_cast<int>(s.rows.size()),
                                candidates, 0.0, nullptr);
  bool any = false;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    if (links[i].row < 0) continue;
    const auto row = static_cast<std::size_t>(links[i].row);
    const double share = std::isinf(expected[i].limit_mm)
                             ? 0.0
                             : (s.rows.position_mm[row] - expected[i].place_mm).norm() /
                                   expected[i].limit_mm * s.options.max_share_of_spacing;
    // Another point is a spacing away at least; the limit taken for two deviations.
    const double deviation = 0.5 * s.options.max_share_of_spacing;
    s.Give(expected[i].track, links[i].row,
           (std::pow(1.0 - share, 2) - share * share) / (2.0 * deviation * deviation));
    any = true;
  }
  return any;
}

}  // namespace

void PredictByNeighbours(TrackerState& s) {
  int coded = 0;
  for (const int t : s.active) coded += s.track(t).row >= 0;
  if (coded < NeighbourMotion::kLeastPoints) return;
  BodyMotions bodies(s);
  for (const int t : s.active) {
    Track& track = s.track(t);
    if (!Loose(track) || track.predicted.deviation_mm() < kOwnMotionGood * s.spacing_mm) continue;
    const NeighbourMotion* motion = bodies.Since(track);
    if (!motion) continue;
    const NeighbourMotion::Place place = bodies.Move(*motion, track);
    if (!(place.variance_mm2 < std::pow(track.predicted.deviation_mm(), 2))) continue;
    s.Carry(track, place);
    track.own_motion = false;
  }
}

void LinkByNeighbours(TrackerState& s) {
  // Points that are in none of the places where their worlds expect them are
  // looked for as others are.
  for (HypothesisGroup& group : s.groups) {
    const auto seen = [&](int t) { return s.track(t).row >= 0; };
    if (std::any_of(group.members.begin(), group.members.end(), seen)) continue;
    group.Release(s);
    for (std::size_t m = 0; m < group.members.size(); ++m) {
      s.track(group.members[m]).predicted = group.worlds.front().state[m];
      s.track(group.members[m]).own_motion = true;
    }
    group.members.clear();
  }
  std::erase_if(s.groups, [](const HypothesisGroup& g) { return g.members.empty(); });
  BodyMotions bodies(s);
  for (int round = 0; round < kMaxRounds; ++round) {
    bodies.Refresh();
    std::vector<Eigen::Vector3d> open;
    for (std::size_t r = 0; r < s.rows.size(); ++r) {
      if (s.rows.IsOpen(static_cast<int>(r))) open.push_back(s.rows.position_mm[r]);
    }
    if (open.empty()) return;
    const std::vector<Expected> expected = Expect(s, PointIndex(open), bodies);
    if (expected.empty() || !LinkExpected(s, expected, !ByChance(s, expected))) return;
  }
}

}  // namespace videogrammetry
