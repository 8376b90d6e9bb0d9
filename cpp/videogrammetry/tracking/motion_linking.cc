// Links by the tracks' own motion, sure ones at once, others in groups: tracker.h, steps 2 and 3.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "videogrammetry/tracking/sparse_assignment.h"
#include "videogrammetry/tracking/tracker_state.h"

namespace videogrammetry {
namespace {

constexpr int kMostRows = 8;            // candidates of a track
constexpr double kUnsettledOdds = 3.0;  // least log odds for a point seen once

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
        HypothesisGroup next =
            u < n ? std::move(s_.groups[u]) : HypothesisGroup::Of(s_, singles[u - n]);
        group = group.members.empty() ? std::move(next) : HypothesisGroup::Join(group, next);
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

// Candidate links of tracks that nobody has linked; `loose` says which tracks.
std::vector<LinkCandidate> FindCandidates(TrackerState& s, const std::vector<int>& loose) {
  std::vector<LinkCandidate> candidates;
  std::vector<int> rows;
  for (std::size_t i = 0; i < loose.size(); ++i) {
    const Track& track = s.track(loose[i]);
    const MotionState& predicted = track.predicted;
    const double after_gap = s.ReturnOdds(track);
    const double least = track.last_seen < s.stage - 1 ? kLeastAfterGap : 0.0;
    s.Candidates(predicted, kMostRows, &rows);
    for (const int row : rows) {
      if (!s.rows.IsOpen(row)) continue;
      const double odds = s.LogOdds(predicted, static_cast<std::size_t>(row)) + after_gap;
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
    if (track.last_seen == s.stage - 1 || s.CanBeFound(track)) loose.push_back(t);
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

}  // namespace

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

}  // namespace videogrammetry
