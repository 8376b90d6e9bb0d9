// Points that nothing predicts yet: four positions in a row that move evenly.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "videogrammetry/tracking/tracker_state.h"

namespace videogrammetry {
namespace {

constexpr int kSteps = 8;  // nearest points that the first step may lead to
constexpr int kEnds = 3;   // candidates for each further position
constexpr double kLeastOdds = 3.0;
constexpr int kLeastHits = 4;          // of a track that is followed backwards
constexpr double kLargestShare = 0.5;  // of the spacing, by which an even motion may be missed

struct Chain {
  std::array<int, 3> track{};  // the last first
  int row = 0;
  double log_odds = 0.0;
};

// Points of one stage that were seen then alone.
struct Alone {
  std::vector<int> track;
  std::vector<Eigen::Vector3d> position_mm;
  std::vector<double> variance_mm2;
  PointIndex index;
};

// Those that no later stage has linked.
Alone SeenAlone(TrackerState& s, int stage) {
  Alone alone;
  for (const int t : s.active) {
    const Track& track = s.track(t);
    const Track::Position* p = track.At(stage);
    if (track.hits != 1 || track.group >= 0 || track.row >= 0 || track.dead || !p) continue;
    if (track.number < s.first_free_id) continue;
    alone.track.push_back(t);
    alone.position_mm.push_back(p->position_mm);
    alone.variance_mm2.push_back(p->variance_mm2);
  }
  alone.index = PointIndex(alone.position_mm);
  return alone;
}

double LogDensity(double distance2, double variance) {
  return -0.5 * (distance2 / variance + 3.0 * std::log(2.0 * std::numbers::pi * variance));
}

class ChainSearch {
 public:
  explicit ChainSearch(TrackerState& s) : s_(s) {
    for (std::size_t k = 0; k < 3; ++k) alone_[k] = SeenAlone(s, s.stage - 1 - static_cast<int>(k));
    for (std::size_t r = 0; r < s.rows.size(); ++r) {
      if (s.rows.track[r] >= 0 || s.rows.id[r] >= 0) continue;
      free_rows_.push_back(static_cast<int>(r));
      places_.push_back(s.rows.position_mm[r]);
    }
  }

  std::vector<Chain> Run() {
    const bool possible =
        !free_rows_.empty() && s_.spacing_mm > 0 &&
        std::all_of(alone_.begin(), alone_.end(), [](const Alone& a) { return !a.track.empty(); });
    if (!possible) return {};
    rows_ = PointIndex(places_);
    std::vector<PointIndex::Neighbour> before;
    for (std::size_t b = 0; b < alone_[0].track.size(); ++b) {
      alone_[1].index.Nearest(alone_[0].position_mm[b], kSteps, 3.0 * s_.spacing_mm, &before);
      for (const auto& a : before) Extend(b, static_cast<std::size_t>(a.index));
    }
    std::stable_sort(chains_.begin(), chains_.end(),
                     [](const Chain& x, const Chain& y) { return x.log_odds > y.log_odds; });
    return chains_;
  }

 private:
  double Radius(double variance) const {
    return std::min(s_.options.gate_sigma * std::sqrt(variance), kLargestShare * s_.spacing_mm);
  }

  void Extend(std::size_t b, std::size_t a) {
    const Eigen::Vector3d &xb = alone_[0].position_mm[b], &xa = alone_[1].position_mm[a];
    const double noise = alone_[0].variance_mm2[b];
    const double second = s_.statistics.second_difference_var() + 6.0 * noise;
    const double third = s_.statistics.third_difference_var() + 20.0 * noise;
    std::vector<PointIndex::Neighbour> ends, starts;
    rows_.Nearest(2.0 * xb - xa, kEnds, Radius(second), &ends);
    for (const auto& c : ends) {
      const Eigen::Vector3d& xc = places_[static_cast<std::size_t>(c.index)];
      alone_[2].index.Nearest(3.0 * xa - 3.0 * xb + xc, kEnds, Radius(third), &starts);
      for (const auto& z : starts) {
        // Against four points that met by chance: two of them anywhere in a spacing.
        const double odds = LogDensity(c.distance2, second) + LogDensity(z.distance2, third) +
                            6.0 * std::log(s_.spacing_mm) - std::log(static_cast<double>(kSteps));
        if (odds < kLeastOdds) continue;
        chains_.push_back({{alone_[0].track[b], alone_[1].track[a],
                            alone_[2].track[static_cast<std::size_t>(z.index)]},
                           free_rows_[static_cast<std::size_t>(c.index)],
                           odds});
      }
    }
  }

  TrackerState& s_;
  std::array<Alone, 3> alone_;  // one, two, three stages ago
  std::vector<int> free_rows_;
  std::vector<Eigen::Vector3d> places_;
  PointIndex rows_;
  std::vector<Chain> chains_;
};

// The oldest of the chain's points takes the others' positions.
void Accept(TrackerState& s, const Chain& chain, double log_odds) {
  Track& oldest = s.track(chain.track[2]);
  for (const int t : {chain.track[1], chain.track[0]}) {
    Track& other = s.track(t);
    const Track::Position p = *other.At(other.last_seen);
    const MotionState predicted = Predict(oldest.state, s.statistics.model());
    oldest.state = Update(predicted, p.position_mm, p.variance_mm2 * Eigen::Matrix3d::Identity());
    oldest.Remember(p);
    oldest.last_seen = p.stage;
    oldest.seen |= std::uint64_t{1} << (s.stage - p.stage);
    ++oldest.hits;
    other.dead = true;
    s.Revise(p.stage, p.row, oldest.number, log_odds);
  }
  oldest.settled = true;
  oldest.predicted = Predict(oldest.state, s.statistics.model());
  s.Give(chain.track[2], chain.row, log_odds);
}

// Where a track of four positions in a row was a stage before the first of them.
struct Backward {
  Eigen::Vector3d place_mm;
  double variance_mm2 = 0.0;
};
std::optional<Backward> PlaceBefore(const TrackerState& s, const Track& track) {
  const Track::Position *a = track.At(track.first_seen), *b = track.At(track.first_seen + 1),
                        *c = track.At(track.first_seen + 2);
  if (!a || !b || !c) return std::nullopt;
  return Backward{3.0 * a->position_mm - 3.0 * b->position_mm + c->position_mm,
                  s.statistics.third_difference_var() + 20.0 * a->variance_mm2};
}

}  // namespace

void ExtendBack(TrackerState& s) {
  std::map<int, Alone> alone;
  std::vector<PointIndex::Neighbour> found;
  for (const int t : s.active) {
    Track& track = s.track(t);
    const bool young = track.hits >= kLeastHits && track.row >= 0 && track.group < 0 &&
                       s.stage - track.first_seen < kLeastHits + 3;
    if (track.dead || !young || track.first_seen == 0) continue;
    auto [entry, fresh] = alone.try_emplace(track.first_seen - 1);
    if (fresh) entry->second = SeenAlone(s, track.first_seen - 1);
    const auto before = PlaceBefore(s, track);
    if (!before) continue;
    const double radius = std::min(s.options.gate_sigma * std::sqrt(before->variance_mm2),
                                   kLargestShare * s.spacing_mm);
    entry->second.index.Nearest(before->place_mm, 2, radius, &found);
    if (found.size() != 1) continue;  // none, or not clear which
    const int other = entry->second.track[static_cast<std::size_t>(found[0].index)];
    Track& first = s.track(other);
    if (first.dead) continue;
    first.dead = true;
    if (track.number >= s.first_free_id) {
      s.Rename(t, track.number, first.number);
    } else {
      s.Rename(t, first.number, track.number);
    }
    const Track::Position p = *first.At(first.last_seen);
    track.first_seen = p.stage;
    track.Remember(p);
    track.seen |= std::uint64_t{1} << (s.stage - p.stage);
    ++track.hits;
  }
}

void StartChains(TrackerState& s) {
  const std::vector<Chain> chains = ChainSearch(s).Run();
  std::vector<char> used(s.tracks.size(), 0);
  for (std::size_t i = 0; i < chains.size(); ++i) {
    const Chain& chain = chains[i];
    const auto taken = [&](const Chain& c) {
      return s.rows.track[static_cast<std::size_t>(c.row)] >= 0 ||
             std::any_of(c.track.begin(), c.track.end(),
                         [&](int t) { return used[static_cast<std::size_t>(t)] != 0; });
    };
    if (taken(chain)) continue;
    // The best that shares a point with it and could still stand.
    double alternative = 0.0;
    for (std::size_t k = i + 1; k < chains.size() && alternative == 0.0; ++k) {
      const bool shares = chains[k].row == chain.row ||
                          std::any_of(chain.track.begin(), chain.track.end(), [&](int t) {
                            return std::find(chains[k].track.begin(), chains[k].track.end(), t) !=
                                   chains[k].track.end();
                          });
      if (shares && !taken(chains[k])) alternative = chains[k].log_odds;
    }
    for (const int t : chain.track) used[static_cast<std::size_t>(t)] = 1;
    Accept(s, chain, chain.log_odds - std::max(alternative, 0.0));
  }
}

}  // namespace videogrammetry
