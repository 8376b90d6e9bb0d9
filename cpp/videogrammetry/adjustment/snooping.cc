#include "videogrammetry/adjustment/snooping.h"

#include <algorithm>
#include <cmath>

namespace videogrammetry {
namespace {

double LargestW(const ObservationStatistics& s) { return s.normalised.cwiseAbs().maxCoeff(); }

}  // namespace

SnoopingChange SnoopOnce(Network* network, const std::vector<ObservationStatistics>& statistics,
                         double critical_value, std::vector<int>* rounds_out) {
  SnoopingChange change;
  std::vector<std::size_t> suspects;
  for (std::size_t i = 0; i < statistics.size(); ++i) {
    NetworkObservation& o = network->observations[i];
    const bool fits = statistics[i].valid && LargestW(statistics[i]) <= critical_value;
    if (o.used && !fits) suspects.push_back(i);
    if (!o.used && fits && (*rounds_out)[i] <= 1) {
      o.used = true;
      ++change.readmitted;
    }
  }
  std::sort(suspects.begin(), suspects.end(), [&](std::size_t a, std::size_t b) {
    const double wa = statistics[a].valid ? LargestW(statistics[a]) : HUGE_VAL;
    const double wb = statistics[b].valid ? LargestW(statistics[b]) : HUGE_VAL;
    return wa != wb ? wa > wb : a < b;
  });
  // A picture that fits nowhere (wrong synchronism, another target) goes as a whole.
  std::vector<int> used(network->images.size()), bad(network->images.size());
  for (const NetworkObservation& o : network->observations) used[o.image] += o.used;
  for (const std::size_t i : suspects) ++bad[network->observations[i].image];
  std::vector<bool> image_taken(network->images.size()), point_taken(network->points.size());
  for (const std::size_t i : suspects) {
    NetworkObservation& o = network->observations[i];
    const bool whole = 2 * bad[o.image] > used[o.image];
    if (!whole && (image_taken[o.image] || point_taken[o.point])) continue;
    image_taken[o.image] = true;
    if (!whole) point_taken[o.point] = true;
    o.used = false;
    ++(*rounds_out)[i];
    ++change.rejected;
  }
  return change;
}

SnoopingChange SnoopPriorsOnce(Network* network,
                               const std::vector<ObservationStatistics>& statistics,
                               const std::vector<BarStatistics>& bars,
                               const std::vector<PointStatistics>& points, double critical_value,
                               std::vector<int>* bar_rounds_out,
                               std::vector<int>* point_rounds_out) {
  SnoopingChange change;
  double largest = critical_value;
  for (std::size_t i = 0; i < statistics.size(); ++i) {
    if (!network->observations[i].used || !statistics[i].valid) continue;
    largest = std::max(largest, LargestW(statistics[i]));
  }
  int worst_bar = -1, worst_point = -1;
  for (std::size_t b = 0; b < bars.size(); ++b) {
    NetworkScaleBar& bar = network->scale_bars[b];
    const double w = std::abs(bars[b].normalised);
    if (bar.used && w > largest) {
      largest = w;
      worst_bar = static_cast<int>(b);
    } else if (!bar.used && w <= critical_value && (*bar_rounds_out)[b] <= 1) {
      bar.used = true;
      ++change.readmitted;
    }
  }
  for (std::size_t p = 0; p < points.size(); ++p) {
    if (!points[p].valid) continue;
    NetworkPoint& point = network->points[p];
    if (point.prior_used && points[p].test > largest) {
      largest = points[p].test;
      worst_point = static_cast<int>(p);
    } else if (!point.prior_used && points[p].test <= critical_value &&
               (*point_rounds_out)[p] <= 1) {
      point.prior_used = true;
      ++change.readmitted;
    }
  }
  if (worst_point >= 0) {
    network->points[worst_point].prior_used = false;
    ++(*point_rounds_out)[worst_point];
    ++change.rejected;
  } else if (worst_bar >= 0) {
    network->scale_bars[worst_bar].used = false;
    ++(*bar_rounds_out)[worst_bar];
    ++change.rejected;
  }
  network->prior_block.Update(network->points);
  return change;
}

}  // namespace videogrammetry
