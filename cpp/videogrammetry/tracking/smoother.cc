#include "videogrammetry/tracking/smoother.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <stdexcept>

#include "videogrammetry/tracking/motion_statistics.h"
#include "videogrammetry/tracking/neighbour_motion.h"

namespace videogrammetry {
namespace {

constexpr std::size_t kReach = 12;        // stages before and after a gap that say something of it
constexpr std::size_t kCutStages = 2000;  // cut out for one length of gap
constexpr double kSignificant = 2.0;      // standard errors
constexpr std::size_t kLeastCut = 20;

Matrix9d Transition(double rho) {
  Matrix9d f = Matrix9d::Identity();
  f.block<3, 3>(0, 3).setIdentity();
  f.block<3, 3>(0, 6).diagonal().setConstant(0.5);
  f.block<3, 3>(3, 6).setIdentity();
  f.block<3, 3>(6, 6).diagonal().setConstant(rho);
  return f;
}

// The stages around a gap [begin, end) of a point.
struct Window {
  std::size_t first = 0;
  std::vector<Eigen::Vector3d> position_mm;
  std::vector<Eigen::Matrix3d> cov_mm2;
  std::vector<char> seen;
};

Window Around(const PointTable& table, std::size_t p, std::size_t begin, std::size_t end) {
  Window window;
  window.first = begin - std::min(begin, kReach);
  while (!table.seen[table.at(window.first, p)]) ++window.first;
  const std::size_t last = std::min(table.stages, end + kReach);
  for (std::size_t s = window.first; s < last; ++s) {
    const std::size_t k = table.at(s, p);
    window.position_mm.push_back(table.position_mm[k]);
    window.cov_mm2.push_back(table.cov_mm2[k]);
    window.seen.push_back(table.seen[k] && (s < begin || s >= end));
  }
  return window;
}

std::vector<MotionState> SmoothGap(const PointTable& table, std::size_t p, std::size_t begin,
                                   std::size_t end, const MotionModel& model) {
  const Window w = Around(table, p, begin, end);
  const auto states = SmoothPath(w.position_mm, w.cov_mm2, w.seen, model);
  const auto from = states.begin() + static_cast<std::ptrdiff_t>(begin - w.first);
  return {from, from + static_cast<std::ptrdiff_t>(end - begin)};
}

// Mean squared error, in units of the covariance, where `length` seen stages are taken out.
double CovarianceFactor(const PointTable& table, std::size_t length, const MotionModel& model) {
  std::vector<std::pair<std::size_t, std::size_t>> whole;  // begin and point of a run to cut
  for (std::size_t p = 0; p < table.points; ++p) {
    std::size_t run = 0;
    for (std::size_t s = 0; s < table.stages; ++s) {
      run = table.seen[table.at(s, p)] ? run + 1 : 0;
      if (run >= length + 6) {
        whole.emplace_back(s - length - 2, p);
        run = 0;
      }
    }
  }
  if (whole.size() < kLeastCut) return 1.0;
  const double step = std::max(1.0, static_cast<double>(whole.size() * length) / kCutStages);
  double squares = 0.0, noise = 0.0, expected = 0.0, cuts = 0.0;
  for (double k = 0; k < static_cast<double>(whole.size()); k += step) {
    const auto [begin, p] = whole[static_cast<std::size_t>(k)];
    const auto states = SmoothGap(table, p, begin, begin + length, model);
    for (std::size_t i = 0; i < length; ++i) {
      const std::size_t at = table.at(begin + i, p);
      squares += (table.position_mm[at] - states[i].position_mm()).squaredNorm();
      noise += table.cov_mm2[at].trace();
      expected += states[i].position_cov_mm2().trace();
    }
    ++cuts;
  }
  // e'e = f tr P + tr R for the factor f, which counts where it is significant; the
  // stages of one gap err alike.
  const double factor = (squares - noise) / expected;
  const double error = squares / expected * std::sqrt(2.0 / (3.0 * cuts));
  return std::abs(factor - 1.0) < kSignificant * error ? 1.0 : std::clamp(factor, 0.1, 1e4);
}

struct Estimate {
  Eigen::Vector3d position_mm;
  Eigen::Matrix3d cov_mm2;
};

// Where the points around say that a point was, from one end of its gap.
class Neighbourhood {
 public:
  Neighbourhood(const PointTable& table, int neighbours) : table_(table), neighbours_(neighbours) {}

  std::optional<Estimate> Move(std::size_t p, std::size_t from, std::size_t to) {
    auto [entry, fresh] = motions_.try_emplace({from, to});
    if (fresh) entry->second = Fit(from, to);
    if (!entry->second) return std::nullopt;
    const std::size_t k = table_.at(from, p);
    const auto place = entry->second->motion.Move(table_.position_mm[k]);
    // The shape of the neighbours' covariance, the size of the motion's.
    const Eigen::Matrix3d& shape = entry->second->cov_mm2;
    return Estimate{place.position_mm,
                    table_.cov_mm2[k] + shape * (3.0 * place.variance_mm2 / shape.trace())};
  }

 private:
  struct Fitted {
    NeighbourMotion motion;
    Eigen::Matrix3d cov_mm2;
  };

  std::optional<Fitted> Fit(std::size_t from, std::size_t to) const {
    std::vector<Eigen::Vector3d> before, after;
    Eigen::Matrix3d cov = Eigen::Matrix3d::Zero();
    for (std::size_t p = 0; p < table_.points; ++p) {
      const std::size_t a = table_.at(from, p), b = table_.at(to, p);
      if (!table_.seen[a] || !table_.seen[b]) continue;
      before.push_back(table_.position_mm[a]);
      after.push_back(table_.position_mm[b]);
      cov += table_.cov_mm2[a] + table_.cov_mm2[b];
    }
    // The least redundancy from which the motion's own errors are known.
    if (std::ssize(before) < 2 * NeighbourMotion::kLeastPoints) return std::nullopt;
    cov /= static_cast<double>(before.size());
    const double noise = std::sqrt(cov.trace() / 3.0);
    return Fitted{NeighbourMotion(std::move(before), std::move(after), noise, neighbours_), cov};
  }

  const PointTable& table_;
  int neighbours_;
  std::map<std::pair<std::size_t, std::size_t>, std::optional<Fitted>> motions_;
};

// Both ends' estimates, the nearer the heavier. Both contain the neighbours'
// errors at the stage between, so that the covariances are averaged, not divided.
std::optional<Estimate> ByNeighbours(Neighbourhood& around, std::size_t p, std::size_t begin,
                                     std::size_t end, std::size_t s) {
  const auto a = around.Move(p, begin - 1, s), b = around.Move(p, end, s);
  if (!a || !b) return std::nullopt;
  const double va = a->cov_mm2.trace(), vb = b->cov_mm2.trace(), wa = vb / (va + vb);
  return Estimate{wa * a->position_mm + (1.0 - wa) * b->position_mm,
                  wa * a->cov_mm2 + (1.0 - wa) * b->cov_mm2};
}

}  // namespace

MotionModel LearnMotion(const PointTable& t) {
  double squares = 0.0, count = 0.0;
  for (std::size_t s = 2; s < t.stages; ++s) {
    for (std::size_t p = 0; p < t.points; ++p) {
      const std::size_t a = t.at(s, p), b = t.at(s - 1, p), c = t.at(s - 2, p);
      if (!t.seen[a] || !t.seen[b] || !t.seen[c]) continue;
      squares += (t.position_mm[a] - 2.0 * t.position_mm[b] + t.position_mm[c]).squaredNorm() / 3.0;
      ++count;
    }
  }
  MotionStatistics statistics(count > 0 ? std::sqrt(squares / count) : 1.0);
  const auto variance = [&](std::size_t k) { return t.cov_mm2[k].trace() / 3.0; };
  for (std::size_t s = 2; s < t.stages; ++s) {
    for (std::size_t p = 0; p < t.points; ++p) {
      const std::size_t a = t.at(s, p), b = t.at(s - 1, p), c = t.at(s - 2, p);
      if (!t.seen[a] || !t.seen[b] || !t.seen[c]) continue;
      const std::size_t d = s > 2 ? t.at(s - 3, p) : c;
      const bool fourth = s > 2 && t.seen[d];
      statistics.Add({t.position_mm[a], t.position_mm[b], t.position_mm[c], t.position_mm[d]},
                     {variance(a), variance(b), variance(c), variance(d)}, fourth);
    }
  }
  statistics.Commit();  // all stages count alike
  return statistics.model();
}

std::vector<MotionState> SmoothPath(std::span<const Eigen::Vector3d> position_mm,
                                    std::span<const Eigen::Matrix3d> cov_mm2,
                                    std::span<const char> seen, const MotionModel& model) {
  // A velocity that no difference of two positions exceeds by far.
  double step2 = 0.0;
  std::size_t last = 0;
  for (std::size_t k = 1; k < seen.size(); ++k) {
    if (!seen[k]) continue;
    step2 = std::max(step2, (position_mm[k] - position_mm[last]).squaredNorm());
    last = k;
  }
  const double velocity_var = 100.0 * (step2 + cov_mm2[0].trace() + model.acceleration_var);
  std::vector<MotionState> filtered, predicted;
  for (std::size_t k = 0; k < seen.size(); ++k) {
    predicted.push_back(k == 0 ? StartState(position_mm[0], cov_mm2[0], Eigen::Vector3d::Zero(),
                                            velocity_var * Eigen::Matrix3d::Identity(), model)
                               : Predict(filtered.back(), model));
    filtered.push_back(k > 0 && seen[k] ? Update(predicted[k], position_mm[k], cov_mm2[k])
                                        : predicted[k]);
  }
  const Matrix9d transition = Transition(model.correlation);
  std::vector<MotionState> smooth = filtered;
  for (std::size_t k = seen.size() - 1; k-- > 0;) {
    const Matrix9d gain =
        predicted[k + 1].cov.ldlt().solve(transition * filtered[k].cov).transpose();
    smooth[k].mean += gain * (smooth[k + 1].mean - predicted[k + 1].mean);
    smooth[k].cov += gain * (smooth[k + 1].cov - predicted[k + 1].cov) * gain.transpose();
    smooth[k].cov = 0.5 * (smooth[k].cov + smooth[k].cov.transpose()).eval();
  }
  return smooth;
}

std::vector<char> FillGaps(PointTable* table, const FillOptions& options) {
  const std::size_t n = table->stages * table->points;
  if (table->position_mm.size() != n || table->cov_mm2.size() != n || table->seen.size() != n) {
    throw std::invalid_argument("trajectories: expected stages * points entries of each");
  }
  if (options.largest_gap < 0) throw std::invalid_argument("largest_gap: expected 0 or more");
  if (options.neighbours < 3) throw std::invalid_argument("neighbours: expected 3 or more");
  const PointTable known = *table;
  const MotionModel model = LearnMotion(known);
  Neighbourhood around(known, options.neighbours);
  std::map<std::size_t, double> factors;
  std::vector<char> filled(n, 0);
  for (std::size_t p = 0; p < known.points; ++p) {
    std::size_t end = 0;
    for (std::size_t begin = 1; begin < known.stages; begin = std::max(end, begin + 1)) {
      if (known.seen[known.at(begin, p)] || !known.seen[known.at(begin - 1, p)]) continue;
      end = begin;
      while (end < known.stages && !known.seen[known.at(end, p)]) ++end;
      const std::size_t length = end - begin;
      if (end == known.stages || length > static_cast<std::size_t>(options.largest_gap)) continue;
      const auto [factor, fresh] = factors.try_emplace(length, 1.0);
      if (fresh) factor->second = CovarianceFactor(known, length, model);
      const auto states = SmoothGap(known, p, begin, end, model);
      for (std::size_t s = begin; s < end; ++s) {
        const MotionState& state = states[s - begin];
        Estimate estimate{state.position_mm(), factor->second * state.position_cov_mm2()};
        const auto other = ByNeighbours(around, p, begin, end, s);
        if (other && other->cov_mm2.trace() < estimate.cov_mm2.trace()) estimate = *other;
        table->position_mm[known.at(s, p)] = estimate.position_mm;
        table->cov_mm2[known.at(s, p)] = estimate.cov_mm2;
        filled[known.at(s, p)] = 1;
      }
    }
  }
  return filled;
}

}  // namespace videogrammetry
