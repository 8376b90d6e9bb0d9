// The steps that link tracks by motion: tracker.h.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "videogrammetry/tracking/sparse_assignment.h"
#include "videogrammetry/tracking/tracker_state.h"

namespace videogrammetry {
namespace {

constexpr int kMostRows = 8;            // candidates of a track
constexpr double kUnsettledOdds = 3.0;  // least log odds for a point seen once
constexpr double kLeastAfterGap = 4.6;  // and for one that was not seen in the stage before
constexpr int kMaxRounds = 6;
constexpr int kGuessed = 4;  // stages after which a point seen once is not guessed where it bends
constexpr int kBlowWithin = 2;   // stages not seen behind which a blow may have been
constexpr double kBlow = 2.0;    // times the velocity, what a blow adds
constexpr double kTold = 0.15;   // of the spacing: the neighbours' motion is worth following
constexpr double kFarOff = 3.0;  // spacings that bending may differ from a point's own motion
constexpr std::size_t kPopulation = 8;
constexpr double kChanceShare = 0.6;  // of the limit; by chance the median is 2^(-1/3) = 0.79

class Sets {  // of tracks that belong together
 public:
  explicit Sets(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0); }
  int Find(int i) {
    while (parent_[static_cast<std::size_t>(i)] != i) {
      int& p = parent_[static_cast<std::size_t>(i)];
      p = parent_[static_cast<std::size_t>(p)];
      i = p;
    }
    return i;
  }
  void Join(int a, int b) {
    const int x = Find(a), y = Find(b);
    parent_[static_cast<std::size_t>(std::max(x, y))] = std::min(x, y);
  }

 private:
  std::vector<int> parent_;
};

double Deviation(const MotionState& state) {
  return std::sqrt(state.cov.topLeftCorner<3, 3>().trace() / 3.0);
}

bool Loose(const Track& track) { return track.row < 0 && track.group < 0 && !track.dead; }

// Rows that the groups could have, and single tracks that could have them too,
// become one group each.
class Grouping {
 public:
  explicit Grouping(TrackerState& s) : s_(s) {}

  void Form(const std::vector<int>& singles, const std::vector<LinkCandidate>& candidates) {
    if (s_.groups.empty()) return;
    Sets sets(s_.groups.size() + singles.size());
    std::vector<int> first(s_.rows.size(), -1);  // set of a row's first claimant
    for (std::size_t g = 0; g < s_.groups.size(); ++g) {
      for (const int row : s_.groups[g].PossibleRows(s_))
        Claim(static_cast<int>(g), row, &first, &sets);
    }
    const std::vector<int> of_groups = first;
    std::vector<char> near(singles.size(), 0);
    for (const LinkCandidate& c : candidates) {
      if (of_groups[static_cast<std::size_t>(c.row)] < 0) continue;
      Claim(static_cast<int>(s_.groups.size()) + c.track, c.row, &first, &sets);
      near[static_cast<std::size_t>(c.track)] = 1;
    }
    Collect(singles, near, &sets);
  }

 private:
  void Claim(int who, int row, std::vector<int>* first, Sets* sets) {
    int& f = (*first)[static_cast<std::size_t>(row)];
    if (f < 0) {
      f = who;
    } else {
      sets->Join(who, f);
    }
  }

  void Collect(const std::vector<int>& singles, const std::vector<char>& near, Sets* sets) {
    const std::size_t n = s_.groups.size();
    std::map<int, std::vector<int>> parts;
    for (std::size_t i = 0; i < n + singles.size(); ++i) {
      if (i < n || near[i - n])
        parts[sets->Find(static_cast<int>(i))].push_back(static_cast<int>(i));
    }
    std::vector<HypothesisGroup> joined;
    for (const auto& [root, part] : parts) {
      std::size_t size = 0;
      for (const int i : part) {
        size += static_cast<std::size_t>(i) < n
                    ? s_.groups[static_cast<std::size_t>(i)].members.size()
                    : 1;
      }
      if (size > HypothesisGroup::kMostMembers) {  // too many to follow all: the best is taken
        for (const int i : part) {
          if (static_cast<std::size_t>(i) < n) s_.groups[static_cast<std::size_t>(i)].Release(s_);
        }
        continue;
      }
      HypothesisGroup group;
      for (const int i : part) {
        const auto u = static_cast<std::size_t>(i);
        const HypothesisGroup next = u < n ? s_.groups[u] : HypothesisGroup::Of(s_, singles[u - n]);
        group = group.members.empty() ? next : HypothesisGroup::Join(group, next);
      }
      joined.push_back(std::move(group));
    }
    s_.groups = std::move(joined);
  }

  TrackerState& s_;
};

void StepGroups(TrackerState& s) {
  for (std::size_t g = 0; g < s.groups.size(); ++g) {
    HypothesisGroup& group = s.groups[g];
    for (const int t : group.members) s.track(t).group = static_cast<int>(g);
    group.Step(s);
    group.Publish(s);
  }
}

// Log odds that a point not seen for long is only hidden, not gone: points leave
// as often as they come.
double StillThere(const TrackerState& s, const Track& track) {
  const double missed = s.stage - 1 - track.last_seen;
  return -std::log1p(s.share_new * missed / (1.0 - s.share_seen));
}

// Candidate links of tracks that nobody has linked; `loose` says which tracks.
std::vector<LinkCandidate> FindCandidates(TrackerState& s, const std::vector<int>& loose) {
  std::vector<LinkCandidate> candidates;
  std::vector<int> rows;
  for (std::size_t i = 0; i < loose.size(); ++i) {
    const Track& track = s.track(loose[i]);
    const MotionState& predicted = track.predicted;
    const double still_there = StillThere(s, track);
    const double least = track.last_seen < s.stage - 1 ? kLeastAfterGap : 0.0;
    s.Candidates(predicted, kMostRows, &rows);
    for (const int row : rows) {
      if (!s.rows.IsOpen(row)) continue;
      const double odds = s.LogOdds(predicted, static_cast<std::size_t>(row)) + still_there;
      if (odds > least) candidates.push_back({static_cast<int>(i), row, odds});
    }
  }
  return candidates;
}

std::vector<int> Predicted(TrackerState& s) {
  std::vector<int> loose;
  for (const int t : s.active) {
    const Track& track = s.track(t);
    if (!Loose(track) || !(track.settled || track.informed || !track.own_motion)) continue;
    if (track.last_seen == s.stage - 1 || s.CanBeFound(track.predicted)) loose.push_back(t);
  }
  return loose;
}

// Tracks of one set of the coupled pairs, where a link of theirs is not sure.
std::vector<std::vector<int>> Unsure(TrackerState& s, const std::vector<int>& loose,
                                     const std::vector<TrackLink>& links,
                                     const std::vector<std::pair<int, int>>& coupled) {
  std::vector<std::vector<int>> unsure;
  Sets sets(loose.size());
  for (const auto& [a, b] : coupled) sets.Join(a, b);
  std::map<int, std::vector<int>> parts;
  for (std::size_t i = 0; i < loose.size(); ++i) {
    if (links[i].margin < s.options.min_log_odds) parts[sets.Find(static_cast<int>(i))];
  }
  if (parts.empty()) return unsure;
  for (std::size_t i = 0; i < loose.size(); ++i) {
    if (const auto found = parts.find(sets.Find(static_cast<int>(i))); found != parts.end()) {
      found->second.push_back(static_cast<int>(i));
    }
  }
  for (const auto& [root, part] : parts) {
    const bool follow =
        part.size() <= HypothesisGroup::kMostMembers &&
        std::any_of(part.begin(), part.end(),
                    [&](int i) { return s.track(loose[static_cast<std::size_t>(i)]).settled; }) &&
        std::all_of(part.begin(), part.end(),
                    [&](int i) { return s.track(loose[static_cast<std::size_t>(i)]).own_motion; });
    if (follow) unsure.push_back(part);
  }
  return unsure;
}

void OpenGroup(TrackerState& s, const std::vector<int>& tracks) {
  HypothesisGroup group;
  for (const int t : tracks) {
    const HypothesisGroup one = HypothesisGroup::Of(s, t);
    group = group.members.empty() ? one : HypothesisGroup::Join(group, one);
    s.track(t).group = static_cast<int>(s.groups.size());
  }
  group.Step(s);
  group.Publish(s);
  s.groups.push_back(std::move(group));
}

// A place that a loose track is expected at and how far from it it may be.
struct Expected {
  int track = 0;
  Eigen::Vector3d place_mm = Eigen::Vector3d::Zero();
  double limit_mm = 0.0;
  bool guessed = false;  // a point seen once, by nothing but its place
};

std::vector<Expected> Expect(TrackerState& s, const PointIndex& open) {
  std::vector<Expected> expected;
  BodyMotions bodies(s);
  for (const int t : s.active) {
    const Track& track = s.track(t);
    if (!Loose(track)) continue;
    bool told = false;  // by the points around
    Expected e{t, track.predicted.position_mm(), std::numeric_limits<double>::infinity(), false};
    // Bending is worked out for those alone that could have a row.
    if (!bodies.Rigid() && ((!track.settled && track.last_seen < s.stage - kGuessed) ||
                            open.Distance(e.place_mm, 1) > kFarOff * s.spacing_mm)) {
      continue;
    }
    if (const NeighbourMotion* motion = bodies.Since(track)) {
      const NeighbourMotion::Place place = bodies.Move(*motion, track);
      e.place_mm = place.position_mm;
      told = place.variance_mm2 < std::pow(kTold * s.spacing_mm, 2);
      const double noise = motion->rigid() ? s.rows.largest_variance_mm2 : 0.0;
      // Bending differs from place to place: while a point is watched, its
      // neighbours' agreement is no limit.
      if (motion->rigid() || track.last_seen < s.stage - 1 - kBlowWithin) {
        e.limit_mm = s.options.gate_sigma * std::sqrt(3.0 * (place.variance_mm2 + noise));
      }
    } else {
      e.guessed = !track.settled;
    }
    if (track.settled && track.own_motion && track.last_seen < s.stage - 1 && !told) {
      // A blow turns a velocity round at most; behind a long gap it is not looked for.
      double reach = 2.0 * s.options.gate_sigma * Deviation(track.predicted);
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

const NeighbourMotion* BodyMotions::Since(const Track& track) {
  // Beyond the memory the state stands for the point, carried from stage to stage.
  const Track::Position* last = track.At(track.last_seen);
  return From(last ? track.last_seen : s_.stage - 1);
}

bool BodyMotions::Rigid() {
  const NeighbourMotion* motion = From(s_.stage - 1);
  return !motion || motion->rigid();  // too few points tell nothing
}

const NeighbourMotion* BodyMotions::From(int from) {
  auto [entry, fresh] = from_.try_emplace(from);
  if (fresh) {
    std::vector<Eigen::Vector3d> before, after;
    std::vector<double> variance;
    for (const int t : s_.active) {
      const Track& other = s_.track(t);
      const Track::Position* p = other.row >= 0 ? other.At(from) : nullptr;
      if (!p) continue;
      const auto row = static_cast<std::size_t>(other.row);
      before.push_back(p->position_mm);
      after.push_back(s_.rows.position_mm[row]);
      variance.push_back(p->variance_mm2 + s_.rows.variance_mm2[row]);
    }
    if (std::ssize(before) >= NeighbourMotion::kLeastPoints) {
      std::nth_element(variance.begin(), variance.begin() + std::ssize(variance) / 2,
                       variance.end());
      entry->second.emplace(std::move(before), std::move(after),
                            std::sqrt(variance[variance.size() / 2]), s_.options.neighbours);
    }
  }
  return entry->second ? &*entry->second : nullptr;
}

NeighbourMotion::Place BodyMotions::Move(const NeighbourMotion& motion, const Track& track) const {
  const Track::Position* last = track.At(track.last_seen);
  NeighbourMotion::Place place = motion.Move(last ? last->position_mm : track.state.position_mm());
  place.variance_mm2 += last ? last->variance_mm2 : std::pow(Deviation(track.state), 2);
  return place;
}

void PredictByNeighbours(TrackerState& s) {
  int coded = 0;
  for (const int t : s.active) coded += s.track(t).row >= 0;
  if (coded < NeighbourMotion::kLeastPoints) return;
  BodyMotions bodies(s);
  for (const int t : s.active) {
    Track& track = s.track(t);
    if (!Loose(track) || Deviation(track.predicted) < kOwnMotionGood * s.spacing_mm) continue;
    const NeighbourMotion* motion = bodies.Since(track);
    if (!motion) continue;
    const NeighbourMotion::Place place = bodies.Move(*motion, track);
    if (!(place.variance_mm2 < std::pow(Deviation(track.predicted), 2))) continue;
    s.Carry(track, place);
    track.own_motion = false;
  }
}

void LinkByMotion(TrackerState& s) {
  std::vector<int> loose = Predicted(s);
  std::vector<LinkCandidate> candidates = FindCandidates(s, loose);
  if (!s.groups.empty()) {
    Grouping(s).Form(loose, candidates);
    StepGroups(s);
    loose = Predicted(s);
    candidates = FindCandidates(s, loose);
  }
  std::vector<std::pair<int, int>> coupled;
  const auto links = AssignRows(static_cast<int>(loose.size()), static_cast<int>(s.rows.size()),
                                candidates, s.options.min_log_odds, &coupled);
  std::vector<std::vector<int>> unsure;
  if (s.options.window_stages > 0) unsure = Unsure(s, loose, links, coupled);
  std::vector<char> grouped(loose.size(), 0);
  for (std::vector<int>& part : unsure) {
    for (int& i : part) {
      grouped[static_cast<std::size_t>(i)] = 1;
      i = loose[static_cast<std::size_t>(i)];
    }
  }
  // Sure links first, so that groups do not reach for their rows.
  for (std::size_t i = 0; i < loose.size(); ++i) {
    if (grouped[i] || links[i].row < 0) continue;
    if (!s.track(loose[i]).settled && links[i].margin < kUnsettledOdds) continue;
    s.Give(loose[i], links[i].row, links[i].margin);
  }
  for (const std::vector<int>& part : unsure) OpenGroup(s, part);
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
  for (int round = 0; round < kMaxRounds; ++round) {
    std::vector<Eigen::Vector3d> open;
    for (std::size_t r = 0; r < s.rows.size(); ++r) {
      if (s.rows.IsOpen(static_cast<int>(r))) open.push_back(s.rows.position_mm[r]);
    }
    if (open.empty()) return;
    const std::vector<Expected> expected = Expect(s, PointIndex(open));
    if (expected.empty() || !LinkExpected(s, expected, !ByChance(s, expected))) return;
  }
}

}  // namespace videogrammetry
