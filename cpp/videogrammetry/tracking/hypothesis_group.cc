#include "videogrammetry/tracking/hypothesis_group.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "videogrammetry/tracking/tracker_state.h"

namespace videogrammetry {
namespace {

constexpr int kMostRows = 4;    // that a member may have in one world
constexpr int kAgreement = 6;   // stages of equal rows after which worlds are one
constexpr double kSure = 30.0;  // log odds where no other world is left

// A way to continue a world.
struct Continuation {
  double weight = 0.0;
  int world = 0;
  std::vector<int> rows;
};

struct Choice {
  int row = -1;
  double log_odds = 0.0;
  bool forced = false;  // by a code: nothing else is possible
};

constexpr double kLeastByCode = -60.0;  // log odds of a code that a world did not expect there

// All assignments of a world's members within kForget of the best seen so far.
class Enumeration {
 public:
  Enumeration(const std::vector<std::vector<Choice>>& choices, double start, int world,
              double* best, std::vector<Continuation>* found)
      : choices_(choices), world_(world), best_(best), found_(found), rows_(choices.size(), -1) {
    rest_.assign(choices.size() + 1, 0.0);
    for (std::size_t m = choices.size(); m-- > 0;) {
      rest_[m] = rest_[m + 1] + (choices[m].empty() ? 0.0 : choices[m][0].log_odds);
    }
    Visit(0, start);
  }

 private:
  void Visit(std::size_t member, double weight) {
    if (weight + rest_[member] < *best_ - HypothesisGroup::kForget) return;
    if (member == choices_.size()) {
      *best_ = std::max(*best_, weight);
      found_->push_back({weight, world_, rows_});
      return;
    }
    for (const Choice& choice : choices_[member]) {
      if (std::find(rows_.begin(), rows_.begin() + static_cast<std::ptrdiff_t>(member),
                    choice.row) != rows_.begin() + static_cast<std::ptrdiff_t>(member)) {
        continue;
      }
      rows_[member] = choice.row;
      Visit(member + 1, weight + choice.log_odds);
    }
    rows_[member] = -1;
    if (choices_[member].empty() || !choices_[member][0].forced) Visit(member + 1, weight);
  }

  const std::vector<std::vector<Choice>>& choices_;
  int world_;
  double* best_;
  std::vector<Continuation>* found_;
  std::vector<int> rows_;
  std::vector<double> rest_;
};

void KeepLikeliest(std::vector<HypothesisGroup::World>* worlds) {
  std::stable_sort(worlds->begin(), worlds->end(),
                   [](const auto& a, const auto& b) { return a.weight > b.weight; });
  const double best = worlds->front().weight;
  std::erase_if(*worlds, [&](const auto& w) { return w.weight < best - HypothesisGroup::kForget; });
  if (worlds->size() > HypothesisGroup::kMostWorlds) worlds->resize(HypothesisGroup::kMostWorlds);
}

// Rows of a world's history that two members have both.
bool Collide(const HypothesisGroup::World& a, const HypothesisGroup::World& b, int shift_a,
             int shift_b) {
  const int stages = static_cast<int>(std::max(a.rows.size(), b.rows.size()));
  for (int t = 0; t < stages; ++t) {
    const int ta = t - shift_a, tb = t - shift_b;
    if (ta < 0 || tb < 0) continue;
    for (const int row : a.rows[static_cast<std::size_t>(ta)]) {
      const auto& other = b.rows[static_cast<std::size_t>(tb)];
      if (row >= 0 && std::find(other.begin(), other.end(), row) != other.end()) return true;
    }
  }
  return false;
}

}  // namespace

HypothesisGroup HypothesisGroup::Of(TrackerState& s, int t) {
  HypothesisGroup group;
  const Track& track = s.track(t);
  group.members = {t};
  World world;
  world.state = {track.state};
  world.alive = {1};
  // The rows so far, so that worlds know what this point was made of.
  group.first_stage = std::max(track.first_seen, s.stage - s.options.window_stages);
  for (int stage = group.first_stage; stage < s.stage; ++stage) {
    const Track::Position* p = track.At(stage);
    world.rows.push_back({p ? p->row : -1});
  }
  group.worlds = {std::move(world)};
  return group;
}

HypothesisGroup HypothesisGroup::Join(const HypothesisGroup& a, const HypothesisGroup& b) {
  HypothesisGroup both;
  both.members = a.members;
  both.members.insert(both.members.end(), b.members.begin(), b.members.end());
  both.first_stage = std::min(a.first_stage, b.first_stage);
  const int shift_a = a.first_stage - both.first_stage, shift_b = b.first_stage - both.first_stage;
  const std::size_t na = a.members.size(), nb = b.members.size();
  for (const World& wa : a.worlds) {
    for (const World& wb : b.worlds) {
      World w;
      w.weight = wa.weight + wb.weight;
      w.state = wa.state;
      w.state.insert(w.state.end(), wb.state.begin(), wb.state.end());
      if (wa.predicted.size() == na && wb.predicted.size() == nb) {
        w.predicted = wa.predicted;
        w.predicted.insert(w.predicted.end(), wb.predicted.begin(), wb.predicted.end());
      }
      w.alive = wa.alive;
      w.alive.insert(w.alive.end(), wb.alive.begin(), wb.alive.end());
      const std::size_t stages = std::max(wa.rows.size() + static_cast<std::size_t>(shift_a),
                                          wb.rows.size() + static_cast<std::size_t>(shift_b));
      w.rows.assign(stages, std::vector<int>(na + nb, -1));
      // A point that began where the other's world already has its rows is none.
      const bool collide = Collide(wa, wb, shift_a, shift_b);
      if (collide && na > 1 && nb > 1) continue;
      for (std::size_t t = 0; t < wa.rows.size(); ++t) {
        if (collide && na == 1 && nb > 1) break;
        std::copy(wa.rows[t].begin(), wa.rows[t].end(),
                  w.rows[t + static_cast<std::size_t>(shift_a)].begin());
      }
      for (std::size_t t = 0; t < wb.rows.size(); ++t) {
        if (collide && !(na == 1 && nb > 1)) break;
        std::copy(wb.rows[t].begin(), wb.rows[t].end(),
                  w.rows[t + static_cast<std::size_t>(shift_b)].begin() +
                      static_cast<std::ptrdiff_t>(na));
      }
      if (collide) w.alive[na == 1 && nb > 1 ? 0 : na] = 0;
      both.worlds.push_back(std::move(w));
    }
  }
  if (both.worlds.empty()) {  // groups whose histories exclude each other: the best of the first
    World w = a.worlds.front();
    w.state.insert(w.state.end(), b.worlds.front().state.begin(), b.worlds.front().state.end());
    w.predicted.clear();
    w.alive.insert(w.alive.end(), nb, 0);
    w.rows.insert(w.rows.begin(), static_cast<std::size_t>(shift_a), std::vector<int>(na, -1));
    for (auto& rows : w.rows) rows.insert(rows.end(), nb, -1);
    both.worlds.push_back(std::move(w));
  }
  KeepLikeliest(&both.worlds);
  return both;
}

void HypothesisGroup::PredictWorlds(TrackerState& s) {
  for (World& world : worlds) {
    for (std::size_t m = world.predicted.size(); m < members.size(); ++m) {
      world.predicted.push_back(Predict(world.state[m], s.ModelOf(s.track(members[m]))));
    }
  }
}

std::vector<int> HypothesisGroup::PossibleRows(TrackerState& s) {
  PredictWorlds(s);
  std::vector<int> rows, found;
  for (const World& world : worlds) {
    for (std::size_t m = 0; m < members.size(); ++m) {
      if (!world.alive[m]) continue;
      const MotionState& predicted = world.predicted[m];
      s.Candidates(predicted, 2 * kMostRows, &found);
      for (const int row : found) {
        if (s.rows.IsOpen(row) && s.LogOdds(predicted, static_cast<std::size_t>(row)) > 0) {
          rows.push_back(row);
        }
      }
    }
  }
  std::sort(rows.begin(), rows.end());
  rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  return rows;
}

void HypothesisGroup::Step(TrackerState& s) {
  PredictWorlds(s);
  std::vector<Continuation> found;
  std::vector<int> rows;
  double best = -std::numeric_limits<double>::infinity();
  for (std::size_t w = 0; w < worlds.size(); ++w) {
    std::vector<std::vector<Choice>> choices(members.size());
    for (std::size_t m = 0; m < members.size(); ++m) {
      const MotionState& predicted = worlds[w].predicted[m];
      if (!worlds[w].alive[m]) continue;
      if (const int row = s.track(members[m]).row; row >= 0) {
        const double odds = s.LogOdds(predicted, static_cast<std::size_t>(row));
        choices[m].push_back({row, std::max(odds, kLeastByCode), true});
        continue;
      }
      s.Candidates(predicted, 2 * kMostRows, &rows);
      for (const int row : rows) {
        if (!s.rows.IsOpen(row)) continue;
        const double odds = s.LogOdds(predicted, static_cast<std::size_t>(row));
        if (odds > 0) choices[m].push_back({row, odds});
      }
      std::stable_sort(choices[m].begin(), choices[m].end(),
                       [](const Choice& a, const Choice& b) { return a.log_odds > b.log_odds; });
      if (choices[m].size() > kMostRows) choices[m].resize(kMostRows);
    }
    Enumeration(choices, worlds[w].weight, static_cast<int>(w), &best, &found);
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& a, const auto& b) { return a.weight > b.weight; });
  if (found.size() > kMostWorlds) found.resize(kMostWorlds);
  std::vector<World> next;
  for (const Continuation& c : found) {
    if (c.weight < best - kForget) break;
    const auto w = static_cast<std::size_t>(c.world);
    const std::vector<MotionState>& predicted = worlds[w].predicted;
    World world{c.weight - best, {}, {}, worlds[w].alive, worlds[w].rows};
    world.state.reserve(members.size());
    world.rows.push_back(c.rows);
    for (std::size_t m = 0; m < members.size(); ++m) {
      const auto row = static_cast<std::size_t>(c.rows[m]);
      world.state.push_back(
          c.rows[m] < 0 ? predicted[m]
                        : Update(predicted[m], s.rows.position_mm[row], s.rows.cov_mm2[row]));
    }
    next.push_back(std::move(world));
  }
  worlds = std::move(next);
}

void HypothesisGroup::Publish(TrackerState& s) {
  const World& best = worlds.front();
  const int now = first_stage + static_cast<int>(best.rows.size()) - 1;
  // How much likelier than the likeliest world where another has the row.
  const auto margin = [&](std::size_t t, std::size_t m) {
    for (const World& w : worlds) {
      if (w.rows[t][m] != best.rows[t][m]) return best.weight - w.weight;
    }
    return kSure;
  };
  for (std::size_t m = 0; m < members.size(); ++m) {
    Track& track = s.track(members[m]);
    track.state = best.state[m];
    const int row = best.alive[m] ? best.rows.back()[m] : -1;
    if (row >= 0 && track.row < 0) s.Give(members[m], row, margin(best.rows.size() - 1, m));
  }
  for (int stage = std::max(first_stage, s.stage - s.options.window_stages); stage < now; ++stage) {
    const auto t = static_cast<std::size_t>(stage - first_stage);
    std::vector<int>& emitted = s.PastOf(stage).number;
    for (std::size_t m = 0; m < members.size(); ++m) {
      const int row = best.rows[t][m];
      if (row < 0 || emitted[static_cast<std::size_t>(row)] == s.track(members[m]).number) continue;
      s.Revise(stage, row, s.track(members[m]).number, margin(t, m));
    }
    for (std::size_t m = 0; m < members.size(); ++m) {  // said to be a member's, but is not
      const Track& track = s.track(members[m]);
      const Track::Position* p = track.At(stage);
      if (p && p->row != best.rows[t][m] &&
          emitted[static_cast<std::size_t>(p->row)] == track.number) {
        s.Revise(stage, p->row, s.next_id++, margin(t, m));
      }
    }
    for (std::size_t m = 0; m < members.size(); ++m) {
      Track& track = s.track(members[m]);
      const int row = best.rows[t][m];
      if (const auto* p = track.At(stage); (p ? p->row : -1) == row) continue;
      const std::uint64_t bit = std::uint64_t{1} << (s.stage - stage);
      track.seen = row < 0 ? track.seen & ~bit : track.seen | bit;
      track.past[static_cast<std::size_t>(stage % kMemoryStages)] =
          row < 0 ? Track::Position{} : s.PastOf(stage).row[static_cast<std::size_t>(row)];
      if (row >= 0) track.last_seen = std::max(track.last_seen, stage);
    }
  }
}

bool HypothesisGroup::Settle(const TrackerState& s) {
  const World& best = worlds.front();
  const std::size_t stages = best.rows.size();
  const int oldest = s.stage - s.options.window_stages;
  if (const int t = oldest - first_stage; t >= 0) {
    for (std::size_t w = worlds.size(); w-- > 1;) {
      for (int k = 0; k <= t; ++k) {
        if (worlds[w].rows[static_cast<std::size_t>(k)] != best.rows[static_cast<std::size_t>(k)]) {
          worlds.erase(worlds.begin() + static_cast<std::ptrdiff_t>(w));
          break;
        }
      }
    }
    for (World& w : worlds) w.rows.erase(w.rows.begin(), w.rows.begin() + t);
    first_stage += t;
  }
  if (worlds.size() > 1 && stages >= kAgreement) {
    // States that were given the same rows for long are the same.
    const auto same = [&](const World& w) {
      return std::equal(
          best.rows.end() - std::min<std::ptrdiff_t>(kAgreement, std::ssize(best.rows)),
          best.rows.end(), w.rows.end() - std::min<std::ptrdiff_t>(kAgreement, std::ssize(w.rows)));
    };
    worlds.erase(std::remove_if(worlds.begin() + 1, worlds.end(), same), worlds.end());
  }
  return worlds.size() == 1;
}

void HypothesisGroup::Release(TrackerState& s) {
  for (std::size_t m = 0; m < members.size(); ++m) {
    Track& track = s.track(members[m]);
    track.group = -1;
    if (!worlds.front().alive[m]) track.dead = true;
  }
}

}  // namespace videogrammetry
