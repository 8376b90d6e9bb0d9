#include "videogrammetry/adjustment/starved.h"

#include <algorithm>
#include <utility>

namespace videogrammetry {
namespace {

constexpr int kSetAside = 2;

bool HoldStarvedPoses(Network* network, std::vector<int>* rounds_out) {
  constexpr int kMinPoints = 4;
  std::vector<int> count(network->poses.size());
  std::vector<std::vector<bool>> seen(count.size(), std::vector<bool>(network->points.size()));
  for (const NetworkObservation& o : network->observations) {
    if (!o.used) continue;
    for (const int pose : {network->images[o.image].inner, network->images[o.image].outer}) {
      if (pose < 0 || seen[pose][o.point]) continue;
      seen[pose][o.point] = true;
      ++count[pose];
    }
  }
  auto starved = [&](int pose) {
    return pose >= 0 && network->poses[pose].free && count[pose] < kMinPoints;
  };
  bool held = false;
  for (std::size_t i = 0; i < network->observations.size(); ++i) {
    NetworkObservation& o = network->observations[i];
    const NetworkImage& image = network->images[o.image];
    if (!starved(image.inner) && !starved(image.outer)) continue;
    o.used = false;
    (*rounds_out)[i] = kSetAside;
    held = true;
  }
  for (std::size_t p = 0; p < count.size(); ++p) {
    if (starved(static_cast<int>(p))) network->poses[p].free = false;
  }
  return held;
}

bool HoldStarvedPoints(Network* network, std::vector<int>* rounds_out,
                       std::vector<int>* bar_rounds_out) {
  std::vector<std::vector<int>> images(network->points.size());
  for (const NetworkObservation& o : network->observations) {
    if (!o.used) continue;
    auto& seen = images[o.point];
    if (std::find(seen.begin(), seen.end(), o.image) == seen.end()) seen.push_back(o.image);
  }
  bool held = false;
  for (std::size_t p = 0; p < images.size(); ++p) {
    const NetworkPoint& point = network->points[p];
    if (!point.is_unknown() || point.is_observed() || images[p].size() >= 2) continue;
    HoldPoint(network, static_cast<int>(p), rounds_out, bar_rounds_out);
    held = true;
  }
  return held;
}

}  // namespace

void HoldPoint(Network* network, int point, std::vector<int>* rounds_out,
               std::vector<int>* bar_rounds_out) {
  network->points[point].starved = true;
  for (std::size_t i = 0; i < network->observations.size(); ++i) {
    if (network->observations[i].point != point) continue;
    network->observations[i].used = false;
    (*rounds_out)[i] = kSetAside;
  }
  for (std::size_t b = 0; b < network->scale_bars.size(); ++b) {
    NetworkScaleBar& bar = network->scale_bars[b];
    if (bar.a != point && bar.b != point) continue;
    bar.used = false;
    (*bar_rounds_out)[b] = kSetAside;
  }
  network->prior_block.Update(network->points);
}

bool HoldStarved(Network* network, std::vector<int>* rounds_out, std::vector<int>* bar_rounds_out) {
  const bool poses = HoldStarvedPoses(network, rounds_out);
  return HoldStarvedPoints(network, rounds_out, bar_rounds_out) || poses;
}

}  // namespace videogrammetry
