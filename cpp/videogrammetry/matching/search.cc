#include "videogrammetry/matching/search.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>

#include "videogrammetry/matching/key_set.h"

namespace videogrammetry {
namespace {

// A seed grows into this many sets at most.
constexpr int kMaxLeaves = 24;
// Among many cameras, targets of so sure a set need no further seeds.
constexpr std::size_t kSettledCameras = 6;
constexpr double kSettledScore = 40.0;
// Contested targets of a set whose parts are all looked at.
constexpr std::size_t kMaxContested = 3;
// Targets of a camera whose seeds are one piece of work, and how many make threads worth it.
constexpr std::size_t kBlock = 64, kManyTargets = 256;

bool Settles(const Candidate& candidate) {
  return candidate.size() >= kSettledCameras && candidate.score > kSettledScore;
}

void Sort(std::vector<ViewTarget>* used) {
  std::sort(used->begin(), used->end(),
            [](const ViewTarget& p, const ViewTarget& q) { return p.camera < q.camera; });
}

// What is known from the pairs of cameras before.
struct Progress {
  FreeTargets settled;
  KeySet pairs, sets;
  std::vector<Candidate> found;

  void Add(Candidate&& candidate) {
    const std::vector<ViewTarget>& used = candidate.used;
    if (!sets.insert(SetKey(used))) return;
    for (std::size_t i = 0; candidate.size() > 2 && i < used.size(); ++i) {
      for (std::size_t j = i + 1; j < used.size(); ++j) pairs.insert(SetKey(used[i], used[j]));
    }
    if (Settles(candidate)) {
      for (const ViewTarget& s : used) {
        settled[static_cast<std::size_t>(s.camera)][static_cast<std::size_t>(s.target)] = 1;
      }
    }
    found.push_back(std::move(candidate));
  }
};

// The seeds of a block of one camera's targets with another camera's.
class Block {
 public:
  Block(const CandidateMaker& maker, const PairFinder& pairs, const FreeTargets& free,
        const StageStatistics& statistics, const Progress& before)
      : maker_(maker), pairs_(pairs), free_(free), statistics_(statistics), before_(before) {
    place_.resize(maker.cameras().size());
  }

  void Run(const CameraPair& pair, std::size_t first, std::size_t last,
           std::vector<Candidate>* found) {
    found_ = found;
    for (std::size_t i = first; i < last; ++i) {
      if (before_.settled[pair.a][i]) continue;
      settled_ = false;
      pairs_.Partners(pair, i, free_, &partners_);
      for (const int j : partners_) {
        if (settled_) break;
        if (before_.settled[pair.b][static_cast<std::size_t>(j)]) continue;
        Seed({static_cast<int>(pair.a), static_cast<int>(i)}, {static_cast<int>(pair.b), j});
      }
    }
  }

 private:
  struct Hypothesis {
    std::vector<ViewTarget> used;
    PointEstimate point;
    double score = 0.0;
  };

  void Seed(const ViewTarget& a, const ViewTarget& b) {
    if (before_.pairs.contains(SetKey(a, b))) return;
    Hypothesis pair;
    pair.used = {a, b};
    if (!maker_.Make(pair.used, &seed_, false, nullptr, false)) return;
    pair.point = seed_.point;
    seed_.in_view = seed_.covered = 0;  // the missed cameras are counted as they are passed
    pair.score = statistics_.Score(seed_);
    leaves_ = 0;
    in_view_ = 0;
    GrowFrom(std::move(pair), 0);
  }

  // Goes through the cameras; where one has several targets at the point's place, or one
  // that does not say much, each is tried, and none of them.
  void GrowFrom(Hypothesis h, std::size_t camera) {
    int id = -1;
    std::uint64_t own = 0;
    for (const ViewTarget& s : h.used) {
      id = std::max(id, maker_.IdOf(s));
      own |= std::uint64_t{1} << s.camera;
    }
    const Eigen::Matrix3d cov = h.point.cov_mm2();
    const std::vector<CameraView>& cameras = maker_.cameras();
    std::vector<NearTarget> near;
    for (std::size_t c = camera; c < cameras.size(); ++c) {
      if ((own >> c) & 1U) continue;
      Eigen::Vector2d xy;
      Eigen::Matrix<double, 2, 3> by;
      if (!cameras[c].Project(h.point.position_mm, &xy, &by)) continue;
      const bool in_view = cameras[c].InPicture(xy);
      if (in_view && h.used.size() == 2) {  // the seed itself
        in_view_ |= std::uint64_t{1} << c;
        place_[c] = xy;
      }
      maker_.Near(xy, by, cov, c, id, free_, &near);
      if (!in_view && near.empty()) continue;
      double share = 0;
      for (const ViewTarget& s : h.used) {
        share += statistics_.seen(static_cast<Eigen::Index>(c), s.camera);
      }
      share /= static_cast<double>(h.used.size());
      const double miss = in_view ? std::log(1 - share + kMergedShare * share) : 0.0;
      if (Branch(h, c, near, share, miss)) return;
      h.score += miss;
      // A pair that so many cameras deny is no point; a larger set is emitted as it is.
      if (in_view && h.used.size() == 2 && h.score < kHopeless - 6) return;
    }
    ++leaves_;
    // Of a pair the score so far is the most that it can be: all misses covered.
    if (h.used.size() > 2 || h.score >= kHopeless) Emit(std::move(h));
  }

  // With each of a camera's targets near to the point; true if it surely is one of them.
  bool Branch(const Hypothesis& h, std::size_t c, const std::vector<NearTarget>& near, double share,
              double miss) {
    double best_gain = -1e9;
    for (std::size_t k = 0; k < std::min<std::size_t>(near.size(), 3); ++k) {
      const double gain = std::log(share) - kLogTwoPi - 0.5 * near[k].log_det -
                          0.5 * near[k].distance2 - statistics_.log_lone[c];
      if (gain - miss < -3 || (k > 0 && gain < best_gain - 9)) continue;
      if (k > 0 && leaves_ >= kMaxLeaves) break;
      best_gain = std::max(best_gain, gain);
      Hypothesis with = h;
      with.used.push_back({static_cast<int>(c), near[k].target});
      with.score += gain;
      if (AdjustPoint(maker_.cameras(), maker_.targets(), with.used, &with.point)) {
        GrowFrom(std::move(with), c + 1);
      }
    }
    return best_gain - miss > kSureGain || (best_gain > -1e8 && leaves_ >= kMaxLeaves);
  }

  void Emit(Hypothesis h) {
    std::vector<ViewTarget> used = std::move(h.used);
    Sort(&used);
    Candidate candidate;
    bool adjusted = true;
    const std::size_t whole = used.size();
    while (used.size() >= 2) {
      if (before_.sets.contains(SetKey(used))) return;
      // Where the cameras see the seed is known from its growing.
      const bool seed = used.size() == 2 && whole == 2;
      if (maker_.Make(used, &candidate, false, adjusted ? &h.point : nullptr, !seed)) {
        if (seed) maker_.LookAt(in_view_, place_, &candidate);
        break;
      }
      if (used.size() == 2 || candidate.point.information.isZero()) return;
      adjusted = false;
      used.erase(used.begin() + static_cast<std::ptrdiff_t>(Worst(used, candidate.point)));
    }
    if (used.size() < 2) return;
    candidate.score = statistics_.Score(candidate);
    if (candidate.score < kHopeless) return;
    settled_ |= Settles(candidate);
    found_->push_back(std::move(candidate));
  }

  // The target that fits worst.
  std::size_t Worst(const std::vector<ViewTarget>& used, const PointEstimate& point) const {
    std::size_t worst = 0;
    double most = -1;
    for (std::size_t k = 0; k < used.size(); ++k) {
      const auto c = static_cast<std::size_t>(used[k].camera);
      const auto t = static_cast<std::size_t>(used[k].target);
      Eigen::Vector2d xy;
      if (!maker_.cameras()[c].Project(point.position_mm, &xy)) continue;
      const Eigen::Vector2d r = maker_.targets()[c].xy(t) - xy;
      const double chi2 = r.dot(maker_.targets()[c].weight(t) * r);
      if (chi2 > most) {
        most = chi2;
        worst = k;
      }
    }
    return worst;
  }

  const CandidateMaker& maker_;
  const PairFinder& pairs_;
  const FreeTargets& free_;
  const StageStatistics& statistics_;
  const Progress& before_;
  std::vector<Candidate>* found_ = nullptr;
  std::vector<int> partners_;
  Candidate seed_;
  std::uint64_t in_view_ = 0;  // cameras that should see the seed, and where
  std::vector<Eigen::Vector2d> place_;
  bool settled_ = false;
  int leaves_ = 0;
};

// Calls f(k) for k < count, each once, on so many threads.
template <typename Function>
void ForEach(std::size_t count, int num_threads, Function f) {
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t k = next++; k < count; k = next++) f(k);
  };
  std::vector<std::thread> threads;
  for (int n = 1; n < num_threads && static_cast<std::size_t>(n) < count; ++n) {
    threads.emplace_back(work);
  }
  work();
  for (std::thread& thread : threads) thread.join();
}

// Where two sets claim a target, either may be right without it.
void AddParts(const CandidateMaker& maker, const StageStatistics& statistics, Progress* progress) {
  std::vector<Candidate>& found = progress->found;
  std::vector<std::vector<int>> claims;
  for (const auto& f : progress->settled) claims.emplace_back(f.size(), 0);
  const auto claim = [&](const ViewTarget& s) -> int& {
    return claims[static_cast<std::size_t>(s.camera)][static_cast<std::size_t>(s.target)];
  };
  for (const Candidate& c : found) {
    for (const ViewTarget& s : c.used) ++claim(s);
  }
  const std::size_t whole = found.size();
  std::vector<ViewTarget> part;
  for (std::size_t k = 0; k < whole; ++k) {
    if (found[k].size() < 3) continue;
    const std::vector<ViewTarget> used = found[k].used;
    std::vector<std::size_t> contested;
    for (std::size_t i = 0; i < used.size(); ++i) {
      if (claim(used[i]) > 1) contested.push_back(i);
    }
    if (contested.size() > kMaxContested) contested.resize(kMaxContested);
    for (unsigned mask = 1; mask < (1U << contested.size()); ++mask) {
      part.clear();
      for (std::size_t i = 0; i < used.size(); ++i) {
        const auto place = std::find(contested.begin(), contested.end(), i) - contested.begin();
        if (place < std::ssize(contested) && ((mask >> place) & 1U)) continue;
        part.push_back(used[i]);
      }
      if (part.size() < 2 || progress->sets.contains(SetKey(part))) continue;
      Candidate candidate;
      if (!maker.Make(part, &candidate)) continue;
      candidate.score = statistics.Score(candidate);
      if (candidate.score < kHopeless) continue;
      progress->sets.insert(SetKey(part));
      found.push_back(std::move(candidate));
    }
  }
}

}  // namespace

std::vector<Candidate> FindCandidates(const CandidateMaker& maker, const PairFinder& pairs,
                                      const FreeTargets& free, const StageStatistics& statistics,
                                      int num_threads) {
  const int threads = num_threads > 0
                          ? num_threads
                          : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  Progress progress;
  progress.settled = free;
  for (auto& s : progress.settled) std::fill(s.begin(), s.end(), 0);
  std::size_t targets = 0;
  for (const auto& f : free) targets += f.size();
  progress.sets = KeySet(4 * targets);
  progress.pairs = KeySet(4 * targets);
  std::vector<std::vector<Candidate>> found;
  for (const CameraPair& pair : pairs.pairs()) {
    const std::size_t n = free[pair.a].size(), blocks = (n + kBlock - 1) / kBlock;
    found.assign(blocks, {});
    ForEach(blocks, n < kManyTargets ? 1 : threads, [&](std::size_t k) {
      Block(maker, pairs, free, statistics, progress)
          .Run(pair, k * kBlock, std::min(n, (k + 1) * kBlock), &found[k]);
    });
    for (auto& block : found) {
      for (Candidate& candidate : block) progress.Add(std::move(candidate));
    }
  }
  AddParts(maker, statistics, &progress);
  return std::move(progress.found);
}

}  // namespace videogrammetry
