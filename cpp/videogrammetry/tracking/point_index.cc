#include "videogrammetry/tracking/point_index.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace videogrammetry {
namespace {

constexpr int kLeaf = 32;

bool Before(const PointIndex::Neighbour& a, const PointIndex::Neighbour& b) {
  return a.distance2 < b.distance2 || (a.distance2 == b.distance2 && a.index < b.index);
}

}  // namespace

PointIndex::PointIndex(std::span<const Eigen::Vector3d> points_mm) {
  order_.resize(points_mm.size());
  std::iota(order_.begin(), order_.end(), 0);
  if (!order_.empty()) Build(0, static_cast<int>(order_.size()), points_mm);
  points_.reserve(order_.size());
  for (const int i : order_) points_.push_back(points_mm[static_cast<std::size_t>(i)]);
}

int PointIndex::Build(int begin, int end, std::span<const Eigen::Vector3d> points_mm) {
  const int node = static_cast<int>(nodes_.size());
  nodes_.push_back({begin, end, -1, 0, 0.0});
  if (end - begin <= kLeaf) return node;
  const auto at = [&](int i) -> const Eigen::Vector3d& {
    return points_mm[static_cast<std::size_t>(order_[static_cast<std::size_t>(i)])];
  };
  Eigen::Vector3d low = at(begin), high = low;
  for (int i = begin + 1; i < end; ++i) {
    low = low.cwiseMin(at(i));
    high = high.cwiseMax(at(i));
  }
  Eigen::Index axis = 0;
  (high - low).maxCoeff(&axis);
  const int middle = begin + (end - begin) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [&](int a, int b) {
                     const double x = points_mm[static_cast<std::size_t>(a)][axis];
                     const double y = points_mm[static_cast<std::size_t>(b)][axis];
                     return x < y || (x == y && a < b);
                   });
  const double split = at(middle)[axis];
  Build(begin, middle, points_mm);
  const int right = Build(middle, end, points_mm);
  Node& self = nodes_[static_cast<std::size_t>(node)];
  self.axis = static_cast<int>(axis);
  self.split = split;
  self.right = right;
  return node;
}

void PointIndex::Nearest(const Eigen::Vector3d& place_mm, int count, double radius_mm,
                         std::vector<Neighbour>* found) const {
  found->clear();
  if (nodes_.empty() || count <= 0) return;
  double limit2 = radius_mm * radius_mm;
  std::pair<int, double> stack[64];  // node and the square of its least distance along one axis
  int depth = 0;
  stack[depth++] = {0, 0.0};
  while (depth > 0) {
    const auto [n, least2] = stack[--depth];
    if (least2 > limit2) continue;
    const Node& node = nodes_[static_cast<std::size_t>(n)];
    if (node.axis >= 0) {
      const double off = place_mm[node.axis] - node.split;
      const int near = off < 0 ? n + 1 : node.right, far = off < 0 ? node.right : n + 1;
      stack[depth++] = {far, off * off};
      stack[depth++] = {near, least2};
      continue;
    }
    for (int i = node.begin; i < node.end; ++i) {
      const double d2 = (points_[static_cast<std::size_t>(i)] - place_mm).squaredNorm();
      if (!(d2 <= limit2)) continue;
      const Neighbour candidate{order_[static_cast<std::size_t>(i)], d2};
      const bool full = static_cast<int>(found->size()) == count;
      if (full && !Before(candidate, found->back())) continue;
      if (full) found->pop_back();
      found->insert(std::upper_bound(found->begin(), found->end(), candidate, Before), candidate);
      if (static_cast<int>(found->size()) == count) limit2 = found->back().distance2;
    }
  }
}

double PointIndex::Distance(const Eigen::Vector3d& place_mm, int rank) const {
  thread_local std::vector<Neighbour> found;
  Nearest(place_mm, rank, std::numeric_limits<double>::infinity(), &found);
  if (static_cast<int>(found.size()) < rank) return std::numeric_limits<double>::infinity();
  return std::sqrt(found.back().distance2);
}

}  // namespace videogrammetry
