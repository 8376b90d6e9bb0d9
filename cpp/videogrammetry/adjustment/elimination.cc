#include "videogrammetry/adjustment/elimination.h"

#include <numeric>
#include <utility>

namespace videogrammetry {
namespace {

constexpr std::size_t kMaxGroup = 4;

using Blocks = std::vector<std::vector<int>>;

void AppendUnknowns(int first, int count, std::vector<int>* unknowns) {
  for (int k = 0; k < count; ++k) unknowns->push_back(first + k);
}

/// Groups of points joined by bars, as their unknowns; no group with a point
/// of the prior block or of more than kMaxGroup unknown points.
Blocks PointBlocks(const Network& network, const UnknownIndex& index) {
  std::vector<int> parent(network.points.size());
  std::iota(parent.begin(), parent.end(), 0);
  auto root = [&](int p) {
    while (parent[p] != p) p = parent[p] = parent[parent[p]];
    return p;
  };
  for (const NetworkScaleBar& bar : network.scale_bars) {
    // A held end joins nothing.
    if (index.point[bar.a] >= 0 && index.point[bar.b] >= 0) parent[root(bar.a)] = root(bar.b);
  }
  Blocks groups(network.points.size());
  std::vector<bool> kept(network.points.size(), false);
  for (const int p : network.prior_block.points) kept[root(p)] = true;
  for (int p = 0; p < static_cast<int>(parent.size()); ++p) {
    if (index.point[p] >= 0) AppendUnknowns(index.point[p], 3, &groups[root(p)]);
  }
  Blocks blocks;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    if (!groups[g].empty() && !kept[g] && groups[g].size() <= 3 * kMaxGroup) {
      blocks.push_back(std::move(groups[g]));
    }
  }
  return blocks;
}

/// The free poses that are inner ones only: every observation meets just one.
Blocks PoseBlocks(const Network& network, const UnknownIndex& index) {
  std::vector<bool> inner(network.poses.size(), false), outer(inner);
  for (const NetworkImage& image : network.images) {
    inner[image.inner] = true;
    if (image.outer >= 0) outer[image.outer] = true;
  }
  Blocks blocks;
  for (std::size_t p = 0; p < network.poses.size(); ++p) {
    if (index.pose[p] < 0 || !inner[p] || outer[p]) continue;
    blocks.emplace_back();
    AppendUnknowns(index.pose[p], 6, &blocks.back());
  }
  return blocks;
}

std::size_t NumUnknowns(const Blocks& blocks) {
  std::size_t sum = 0;
  for (const auto& b : blocks) sum += b.size();
  return sum;
}

}  // namespace

Elimination::Elimination(const Network& network, const UnknownIndex& index, What what) {
  blocks = PointBlocks(network, index);
  Blocks poses = PoseBlocks(network, index);
  if (what == What::kPoses ||
      (what == What::kSmallest && NumUnknowns(poses) > NumUnknowns(blocks))) {
    blocks = std::move(poses);
  }
  block_of.assign(static_cast<std::size_t>(index.num_unknowns), -1);
  place.assign(block_of.size(), 0);
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    for (std::size_t k = 0; k < blocks[b].size(); ++k) {
      block_of[blocks[b][k]] = static_cast<int>(b);
      place[blocks[b][k]] = static_cast<int>(k);
    }
  }
  for (int u = 0; u < index.num_unknowns; ++u) {
    if (block_of[u] >= 0) continue;
    place[u] = static_cast<int>(reduced.size());
    reduced.push_back(u);
  }
}

}  // namespace videogrammetry
