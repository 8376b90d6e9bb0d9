#include "videogrammetry/matching/marginals.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>

namespace videogrammetry {
namespace {

// A candidate of these log odds has half a hundredth at most and is left out.
constexpr double kNegligible = -5.3;
// Larger groups have too many sets in any case; a limit beyond the second asks for them.
constexpr std::size_t kMostSummed = 30;
constexpr int kAlwaysSummed = 100000;
constexpr double kDamping = 0.3;  // of logarithms
constexpr double kConverged = 1e-4;
constexpr double kMostExponent = 650.0, kLeastMessage = 1e-300;

// Targets of all cameras numbered through, and the candidates at each that count.
class Claims {
 public:
  Claims(const std::vector<std::size_t>& num_targets, const std::vector<Candidate>& candidates)
      : offset_(num_targets.size() + 1, 0), candidates_(candidates) {
    std::partial_sum(num_targets.begin(), num_targets.end(), offset_.begin() + 1);
    start_.assign(offset_.back() + 2, 0);
    ForEdges([&](std::size_t, std::size_t t) { ++start_[t + 2]; });
    std::partial_sum(start_.begin(), start_.end(), start_.begin());
    at_.resize(start_.back());
    // Each beginning moves on to the next one's as it is filled.
    ForEdges([&](std::size_t k, std::size_t t) { at_[start_[t + 1]++] = k; });
  }
  std::size_t size() const { return offset_.back(); }
  std::size_t Number(const ViewTarget& s) const {
    return offset_[static_cast<std::size_t>(s.camera)] + static_cast<std::size_t>(s.target);
  }
  std::span<const std::size_t> At(const ViewTarget& s) const { return At(Number(s)); }
  std::span<const std::size_t> At(std::size_t t) const {
    return std::span(at_).subspan(start_[t], start_[t + 1] - start_[t]);
  }

  // Groups of candidates linked by targets, ascending.
  std::vector<std::vector<std::size_t>> Groups() const {
    std::vector<std::size_t> root(candidates_.size()), group_of(candidates_.size(), kNone);
    std::iota(root.begin(), root.end(), 0);
    const auto find = [&](std::size_t k) {
      while (root[k] != k) k = root[k] = root[root[k]];
      return k;
    };
    for (std::size_t t = 0; t < size(); ++t) {
      const auto at = At(t);
      for (std::size_t i = 1; i < at.size(); ++i) root[find(at[i])] = find(at[0]);
    }
    std::vector<std::vector<std::size_t>> groups;
    for (std::size_t k = 0; k < candidates_.size(); ++k) {
      if (!(candidates_[k].score > kNegligible)) continue;
      std::size_t& own = group_of[find(k)];
      if (own == kNone) {
        own = groups.size();
        groups.emplace_back();
      }
      groups[own].push_back(k);
    }
    return groups;
  }

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  template <typename Function>
  void ForEdges(Function f) const {
    for (std::size_t k = 0; k < candidates_.size(); ++k) {
      if (!(candidates_[k].score > kNegligible)) continue;
      for (const ViewTarget& s : candidates_[k].used) f(k, Number(s));
    }
  }

  std::vector<std::size_t> offset_;
  const std::vector<Candidate>& candidates_;
  std::vector<std::size_t> start_, at_;
};

// Sums over all compatible sets of one group.
class Enumeration {
 public:
  Enumeration(const std::vector<std::size_t>& group, const Claims& claims,
              const std::vector<Candidate>& candidates, int limit)
      : limit_(limit), weight_(group.size(), 0.0) {
    for (std::size_t i = 0; i < group.size(); ++i) {
      score_.push_back(candidates[group[i]].score);
      std::vector<std::size_t> against;
      for (const ViewTarget& s : candidates[group[i]].used) {
        for (const std::size_t k : claims.At(s)) {
          const auto j = static_cast<std::size_t>(std::lower_bound(group.begin(), group.end(), k) -
                                                  group.begin());
          if (j > i) against.push_back(j);
        }
      }
      against_.push_back(std::move(against));
    }
    blocked_.assign(group.size(), 0);
  }

  // False if there are too many sets.
  bool Run(const std::vector<std::size_t>& group, std::vector<Candidate>* candidates) {
    if (!Go(0, 0.0)) return false;
    for (std::size_t i = 0; i < group.size(); ++i) {
      (*candidates)[group[i]].probability = weight_[i] / total_;
    }
    return true;
  }

 private:
  bool Go(std::size_t i, double sum) {
    while (i < score_.size() && blocked_[i] > 0) ++i;
    if (i == score_.size()) return Count(sum);
    chosen_.push_back(i);
    for (const std::size_t j : against_[i]) ++blocked_[j];
    const bool with = Go(i + 1, sum + score_[i]);
    for (const std::size_t j : against_[i]) --blocked_[j];
    chosen_.pop_back();
    return with && Go(i + 1, sum);
  }

  bool Count(double sum) {
    if (++count_ > limit_) return false;
    if (sum > scale_) {  // all sums are of exp(. - scale)
      const double factor = std::exp(scale_ - sum);
      for (double& w : weight_) w *= factor;
      total_ *= factor;
      scale_ = sum;
    }
    const double weight = std::exp(sum - scale_);
    total_ += weight;
    for (const std::size_t i : chosen_) weight_[i] += weight;
    return true;
  }

  int limit_, count_ = 0;
  std::vector<double> score_, weight_;
  std::vector<std::vector<std::size_t>> against_;
  std::vector<int> blocked_;
  std::vector<std::size_t> chosen_;
  double total_ = 0.0, scale_ = 0.0;
};

// Belief propagation among the candidates of groups that are closed under sharing targets.
class Propagation {
 public:
  Propagation(const std::vector<std::size_t>& list, const Claims& claims,
              std::vector<Candidate>* candidates)
      : list_(list), candidates_(*candidates), most_(claims.size()), rest_(claims.size()) {
    first_.push_back(0);
    for (const std::size_t k : list) {
      weight_.push_back(std::exp(candidates_[k].score));
      for (const ViewTarget& s : candidates_[k].used) place_.push_back(claims.Number(s));
      first_.push_back(place_.size());
    }
    n_.assign(place_.size(), 1.0);
    m_.resize(place_.size());
  }

  // `end`: of the groups one after another in the list. Nothing passes between them, and each
  // goes on until it has converged itself.
  void Run(std::span<const std::size_t> end, int max_iterations) {
    std::size_t begin = 0;
    for (const std::size_t e : end) {
      for (int i = 0; i < max_iterations; ++i) {
        if (Step(begin, e) < kConverged) break;
      }
      begin = e;
    }
    for (std::size_t i = 0; i < list_.size(); ++i) {
      double odds = weight_[i];
      for (std::size_t e = first_[i]; e < first_[i + 1]; ++e) odds *= n_[e];
      candidates_[list_[i]].probability = 1 / (1 + 1 / odds);
    }
  }

 private:
  // The largest relative change of a message of the candidates of a group.
  double Step(std::size_t begin, std::size_t end) {
    for (std::size_t e = first_[begin]; e < first_[end]; ++e)
      most_[place_[e]] = rest_[place_[e]] = 0;
    for (std::size_t i = begin; i < end; ++i) {
      double all = weight_[i];
      for (std::size_t e = first_[i]; e < first_[i + 1]; ++e) all *= n_[e];
      for (std::size_t e = first_[i]; e < first_[i + 1]; ++e) {
        const double m = all / n_[e];
        double& most = most_[place_[e]];
        m_[e] = m;
        rest_[place_[e]] += std::min(m, most);
        most = std::max(m, most);
      }
    }
    double change = 0;
    for (std::size_t e = first_[begin]; e < first_[end]; ++e) {
      const std::size_t t = place_[e];
      // Without the own one, which may be nearly all of it.
      const double others = m_[e] == most_[t] ? rest_[t] : (rest_[t] - m_[e]) + most_[t];
      const double fresh = 1 / (1 + std::max(others, 0.0));
      // A quarter of the old one, geometrically.
      const double next = std::max(std::sqrt(fresh * std::sqrt(fresh * n_[e])), kLeastMessage);
      change = std::max(change, std::abs(next - n_[e]) / n_[e]);
      n_[e] = next;
    }
    return change;
  }

  const std::vector<std::size_t>& list_;
  std::vector<Candidate>& candidates_;
  std::vector<std::size_t> first_, place_;  // edges: a candidate and one of its targets
  std::vector<double> weight_, n_, m_, most_, rest_;
};

// Sum of exp(log_m - most) over a target's edges without one of them.
double RestWithout(std::size_t e, const std::vector<double>& log_m,
                   const std::vector<std::size_t>& edges, double most) {
  double rest = 0;
  for (const std::size_t other : edges) {
    if (other != e) rest += std::exp(log_m[other] - most);
  }
  return rest;
}

// The same for scores beyond the exponential's range.
void PropagateLogarithms(const std::vector<std::size_t>& group, const Claims& claims,
                         int max_iterations, std::vector<Candidate>* candidates) {
  // Edges: a candidate and one of its targets.
  std::vector<std::size_t> first(group.size() + 1, 0), number;
  for (std::size_t i = 0; i < group.size(); ++i) {
    for (const ViewTarget& s : (*candidates)[group[i]].used) number.push_back(claims.Number(s));
    first[i + 1] = number.size();
  }
  std::vector<std::size_t> places = number;
  std::sort(places.begin(), places.end());
  places.erase(std::unique(places.begin(), places.end()), places.end());
  for (std::size_t& n : number) {
    n = static_cast<std::size_t>(std::lower_bound(places.begin(), places.end(), n) -
                                 places.begin());
  }
  std::vector<std::vector<std::size_t>> edges_at(places.size());
  for (std::size_t e = 0; e < number.size(); ++e) edges_at[number[e]].push_back(e);
  std::vector<double> log_n(number.size(), 0.0), log_m(number.size());
  std::vector<double> most(places.size()), sum(places.size());
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    for (std::size_t i = 0; i < group.size(); ++i) {
      double all = (*candidates)[group[i]].score;
      for (std::size_t e = first[i]; e < first[i + 1]; ++e) all += log_n[e];
      for (std::size_t e = first[i]; e < first[i + 1]; ++e) log_m[e] = all - log_n[e];
    }
    std::fill(most.begin(), most.end(), 0.0);
    std::fill(sum.begin(), sum.end(), 0.0);
    for (std::size_t e = 0; e < number.size(); ++e) {
      most[number[e]] = std::max(most[number[e]], log_m[e]);
    }
    for (std::size_t e = 0; e < number.size(); ++e) {
      sum[number[e]] += std::exp(log_m[e] - most[number[e]]);
    }
    double change = 0;
    for (std::size_t e = 0; e < number.size(); ++e) {
      const std::size_t t = number[e];
      // 1 + the sum without this one, which may be nearly all of it.
      const double own = std::exp(log_m[e] - most[t]);
      const double rest =
          own > 0.5 * sum[t] ? RestWithout(e, log_m, edges_at[t], most[t]) : sum[t] - own;
      const double log_rest = std::log(std::exp(-most[t]) + rest) + most[t];
      const double fresh = -std::max(log_rest, 0.0);
      const double next = (1 - kDamping) * fresh + kDamping * log_n[e];
      change = std::max(change, std::abs(next - log_n[e]));
      log_n[e] = next;
    }
    if (change < kConverged) break;
  }
  for (std::size_t i = 0; i < group.size(); ++i) {
    double odds = (*candidates)[group[i]].score;
    for (std::size_t e = first[i]; e < first[i + 1]; ++e) odds += log_n[e];
    (*candidates)[group[i]].probability = 1 / (1 + std::exp(-odds));
  }
}

}  // namespace

void SetProbabilities(const std::vector<std::size_t>& num_targets,
                      std::vector<Candidate>* candidates, int exact_limit, int max_iterations) {
  const Claims claims(num_targets, *candidates);
  std::vector<std::size_t> rest, end;
  for (Candidate& c : *candidates) c.probability = 0;
  if (exact_limit <= 0) {
    for (std::size_t k = 0; k < candidates->size(); ++k) {
      if ((*candidates)[k].score > kNegligible) rest.push_back(k);
    }
    end.push_back(rest.size());
  } else {
    for (const auto& group : claims.Groups()) {
      if (group.size() == 1) {
        Candidate& alone = (*candidates)[group[0]];
        alone.probability = 1 / (1 + std::exp(-alone.score));
        continue;
      }
      const bool small = group.size() <= kMostSummed || exact_limit > kAlwaysSummed;
      if (small && Enumeration(group, claims, *candidates, exact_limit).Run(group, candidates)) {
        continue;
      }
      rest.insert(rest.end(), group.begin(), group.end());
      end.push_back(rest.size());
    }
  }
  if (std::any_of(rest.begin(), rest.end(),
                  [&](std::size_t k) { return (*candidates)[k].score > kMostExponent; })) {
    PropagateLogarithms(rest, claims, max_iterations, candidates);
  } else {
    Propagation(rest, claims, candidates).Run(end, max_iterations);
  }
}

std::vector<double> ProbabilitiesOfOnePoint(const std::vector<std::size_t>& num_targets,
                                            const std::vector<Candidate>& candidates) {
  const Claims claims(num_targets, candidates);
  std::vector<double> all(candidates.size(), 0.0);
  for (std::size_t k = 0; k < candidates.size(); ++k) {
    if (!(candidates[k].score > kNegligible)) continue;
    for (const std::size_t other : claims.At(candidates[k].used.front())) {
      if (candidates[other].Contains(candidates[k])) all[k] += candidates[other].probability;
    }
    all[k] = std::min(all[k], 1.0);
  }
  return all;
}

}  // namespace videogrammetry
