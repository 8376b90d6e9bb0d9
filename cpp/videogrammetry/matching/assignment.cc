#include "videogrammetry/matching/assignment.h"

#include <algorithm>
#include <limits>

namespace videogrammetry {
namespace {

constexpr int kMaxRounds = 20;

class Packing {
 public:
  Packing(const std::vector<Candidate>& candidates, const std::vector<std::size_t>& num_targets)
      : candidates_(candidates) {
    for (const std::size_t n : num_targets) {
      owner_.emplace_back(n, kNone);
      touching_.emplace_back(n);
    }
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      if (!(candidates[i].score > 0)) continue;
      usable_.push_back(i);
      ForTargets(i, [&](std::size_t c, std::size_t t) { touching_[c][t].push_back(i); });
    }
    std::sort(usable_.begin(), usable_.end(), [&](std::size_t a, std::size_t b) {
      return candidates_[a].score > candidates_[b].score;
    });
  }

  std::vector<Choice> Run() {
    for (const std::size_t i : usable_) {
      if (Owners(i).empty()) Place(i);
    }
    for (int round = 0; round < kMaxRounds && Improve(); ++round) {
    }
    return Margins();
  }

 private:
  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

  // What an exchange would take out and put in, and the gain of the total.
  struct Exchange {
    std::vector<std::size_t> out, in;
    double gain = 0.0;
  };

  template <typename Function>
  void ForTargets(std::size_t i, Function function) const {
    const std::vector<int>& target = candidates_[i].target;
    for (std::size_t c = 0; c < target.size(); ++c) {
      if (target[c] >= 0) function(c, static_cast<std::size_t>(target[c]));
    }
  }

  std::vector<std::size_t> Owners(std::size_t i) const {
    std::vector<std::size_t> owners;
    ForTargets(i, [&](std::size_t c, std::size_t t) {
      const std::size_t owner = owner_[c][t];
      if (owner != kNone && std::find(owners.begin(), owners.end(), owner) == owners.end()) {
        owners.push_back(owner);
      }
    });
    return owners;
  }

  void Place(std::size_t i) {
    ForTargets(i, [&](std::size_t c, std::size_t t) { owner_[c][t] = i; });
  }
  void Remove(std::size_t i) {
    ForTargets(i, [&](std::size_t c, std::size_t t) { owner_[c][t] = kNone; });
  }

  // Puts `i` in place of what it conflicts with and fills what became free,
  // without `banned`; the state is as before on return.
  Exchange Try(std::size_t i, std::size_t banned) {
    Exchange exchange;
    exchange.out = Owners(i);
    exchange.gain = candidates_[i].score;
    exchange.in.push_back(i);
    for (const std::size_t o : exchange.out) {
      exchange.gain -= candidates_[o].score;
      Remove(o);
    }
    Place(i);
    FillFreed(exchange.out, banned, &exchange);
    for (const std::size_t p : exchange.in) Remove(p);
    for (const std::size_t o : exchange.out) Place(o);
    return exchange;
  }

  void FillFreed(const std::vector<std::size_t>& out, std::size_t banned, Exchange* exchange) {
    std::vector<std::size_t> options;
    for (const std::size_t o : out) {
      ForTargets(o, [&](std::size_t c, std::size_t t) {
        if (owner_[c][t] != kNone) return;
        options.insert(options.end(), touching_[c][t].begin(), touching_[c][t].end());
      });
    }
    std::sort(options.begin(), options.end(), [&](std::size_t a, std::size_t b) {
      if (candidates_[a].score != candidates_[b].score) {
        return candidates_[a].score > candidates_[b].score;
      }
      return a < b;
    });
    for (const std::size_t k : options) {
      if (k == banned || !Owners(k).empty()) continue;
      exchange->in.push_back(k);
      exchange->gain += candidates_[k].score;
      Place(k);
    }
  }

  bool Improve() {
    bool changed = false;
    for (const std::size_t i : usable_) {
      const std::vector<std::size_t> owners = Owners(i);
      if (owners.size() == 1 && owners[0] == i) continue;
      const Exchange exchange = Try(i, kNone);
      if (exchange.gain <= 1e-9) continue;
      for (const std::size_t o : exchange.out) Remove(o);
      for (const std::size_t p : exchange.in) Place(p);
      changed = true;
    }
    return changed;
  }

  bool Chosen(std::size_t i) const {
    bool all = true;
    ForTargets(i, [&](std::size_t c, std::size_t t) { all = all && owner_[c][t] == i; });
    return all;
  }

  static bool IsPartOf(const std::vector<int>& small, const std::vector<int>& large) {
    for (std::size_t c = 0; c < small.size(); ++c) {
      if (small[c] >= 0 && small[c] != large[c]) return false;
    }
    return true;
  }

  // Best total without candidate `i` against the best with it. What is only a
  // part of `i` (a camera fewer) tells the same point and is no alternative.
  double Margin(std::size_t i) {
    double best = -candidates_[i].score;
    ForTargets(i, [&](std::size_t c, std::size_t t) {
      for (const std::size_t k : touching_[c][t]) {
        if (k == i || IsPartOf(candidates_[k].target, candidates_[i].target)) continue;
        best = std::max(best, Try(k, i).gain);
      }
    });
    return -best;
  }

  std::vector<Choice> Margins() {
    std::vector<Choice> choices;
    for (const std::size_t i : usable_) {
      if (Chosen(i)) choices.push_back({i, Margin(i)});
    }
    return choices;
  }

  const std::vector<Candidate>& candidates_;
  std::vector<std::size_t> usable_;
  std::vector<std::vector<std::size_t>> owner_;                  // camera, target -> chosen
  std::vector<std::vector<std::vector<std::size_t>>> touching_;  // camera, target -> candidates
};

}  // namespace

std::vector<Choice> ChooseCompatible(const std::vector<Candidate>& candidates,
                                     const std::vector<std::size_t>& num_targets) {
  return Packing(candidates, num_targets).Run();
}

}  // namespace videogrammetry
