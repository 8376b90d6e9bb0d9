#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

namespace videogrammetry {

/// Nearest points by a k-d tree (median split, leaves of at most 32 points).
class PointIndex {
 public:
  struct Neighbour {
    int index = -1;
    double distance2 = 0.0;
  };

  PointIndex() = default;
  explicit PointIndex(std::span<const Eigen::Vector3d> points_mm);

  /// Up to `count` points within `radius_mm`, the nearest first; equal distances
  /// in the order of the points.
  void Nearest(const Eigen::Vector3d& place_mm, int count, double radius_mm,
               std::vector<Neighbour>* found) const;
  /// Distance to the `rank`-th nearest point, from 1; infinite if there are fewer.
  double Distance(const Eigen::Vector3d& place_mm, int rank) const;
  std::size_t size() const { return points_.size(); }

 private:
  struct Node {
    int begin = 0, end = 0, axis = -1, right = 0;  // axis -1: a leaf; left is the next node
    double split = 0.0;
  };
  int Build(int begin, int end, std::span<const Eigen::Vector3d> points_mm);

  std::vector<Node> nodes_;
  std::vector<int> order_;
  std::vector<Eigen::Vector3d> points_;  // in the order of the leaves
};

}  // namespace videogrammetry
