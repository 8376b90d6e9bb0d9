#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "videogrammetry/matching/match.h"

namespace videogrammetry {

/// A camera as matching needs it: its normalised picture (X/Z, Y/Z), in which a
/// projection is linear-fractional and the lens is gone.
class CameraView {
 public:
  explicit CameraView(const OrientedCamera& oriented);

  /// Normalised picture of a point; false behind the camera or its window.
  bool Project(const Eigen::Vector3d& position_mm, Eigen::Vector2d* xy,
               Eigen::Matrix<double, 2, 3>* by_position = nullptr) const;
  /// Whether a normalised place lies in the picture; to the accuracy of the
  /// rectangle through the middles of the picture's edges.
  bool InPicture(const Eigen::Vector2d& xy) const {
    return (xy.array() >= low_.array()).all() && (xy.array() <= high_.array()).all();
  }
  double depth_mm(const Eigen::Vector3d& position_mm) const {
    return rotation_.row(2).dot(position_mm) + translation_.z();
  }

  const OrientedCamera& oriented() const { return *oriented_; }
  bool has_window() const { return oriented_->interface.has_value(); }
  const Eigen::Vector3d& center() const { return center_; }
  const Eigen::Matrix3d& rotation() const { return rotation_; }
  double area() const { return (high_ - low_).prod(); }
  double f_px() const { return oriented_->camera.f_px(); }

 private:
  const OrientedCamera* oriented_;
  Eigen::Matrix3d rotation_;
  Eigen::Vector3d translation_, center_;
  Eigen::Vector2d low_, high_;
};

/// The targets of one picture in normalised coordinates, in the cells of a grid.
class TargetView {
 public:
  /// Replaces what it holds; storage is used again. Without a grid: see MakeGrid.
  void Set(const CameraView& camera, std::span<const Eigen::Vector2d> xy_px,
           std::span<const Eigen::Matrix2d> cov_px2);

  /// What max_sigma, log_det, wide, ForBox and ForSegment need; nothing if it is there.
  void MakeGrid();

  std::size_t size() const { return xy_.size(); }
  bool valid(std::size_t i) const { return valid_[i] != 0; }
  const Eigen::Vector2d& xy(std::size_t i) const { return xy_[i]; }
  const Eigen::Matrix2d& cov(std::size_t i) const { return cov_[i]; }
  const Eigen::Matrix2d& weight(std::size_t i) const { return weight_[i]; }
  /// log of the covariance's determinant.
  double log_det(std::size_t i) const { return log_det_[i]; }
  Eigen::Vector3d origin(std::size_t i) const { return window_ ? origin_[i] : center_; }
  /// Along the ray in the world's frame, of any length.
  const Eigen::Vector3d& direction(std::size_t i) const { return direction_[i]; }
  /// Derivatives of origin and unit direction by the normalised place; with a window only.
  const Eigen::Matrix<double, 3, 2>& origin_by_xy(std::size_t i) const { return origin_by_[i]; }
  const Eigen::Matrix<double, 3, 2>& direction_by_xy(std::size_t i) const {
    return direction_by_[i];
  }
  /// Largest standard deviation of those in the grid.
  double max_sigma() const { return max_sigma_; }

  /// Calls f(i) for the targets in the cells that a box touches.
  template <typename Function>
  void ForBox(const Eigen::Vector2d& low, const Eigen::Vector2d& high, Function f) const {
    for (const int i : wide_) f(static_cast<std::size_t>(i));
    if (columns_ == 0) return;
    const int left = Cell(low.x(), 0), right = Cell(high.x(), 0);
    const int top = Cell(low.y(), 1), bottom = Cell(high.y(), 1);
    for (int y = top; y <= bottom; ++y) ForCells(y, left, right, f);
  }

  /// Calls f(i) for the targets in the cells within `reach` of a segment.
  template <typename Function>
  void ForSegment(Eigen::Vector2d from, Eigen::Vector2d to, double reach, Function f) const {
    if (columns_ == 0) return;
    const Eigen::Vector2d along = to - from;
    const bool steep = std::abs(along.y()) > std::abs(along.x());
    const int u = steep ? 1 : 0, v = steep ? 0 : 1;
    if (from[u] > to[u]) std::swap(from, to);
    const double length = to[u] - from[u];
    const double slope = length > 0 ? (to[v] - from[v]) / length : 0.0;
    const double wide = reach * std::sqrt(1 + slope * slope);
    if (to[u] + reach < low_[u] || from[u] - reach > low_[u] + cell_[u] * count(u)) return;
    const int first = Cell(from[u] - reach, u), last = Cell(to[u] + reach, u);
    for (int k = first; k <= last; ++k) {
      const double begin = std::max(low_[u] + k * cell_[u], from[u] - reach) - from[u];
      const double end = std::min(low_[u] + (k + 1) * cell_[u], to[u] + reach) - from[u];
      const double a = from[v] + slope * begin, b = from[v] + slope * end;
      const double least = std::min(a, b) - wide, most = std::max(a, b) + wide;
      if (most < low_[v] || least > low_[v] + cell_[v] * count(v)) continue;
      const int start = Cell(least, v), stop = Cell(most, v);
      if (steep) {
        ForCells(k, start, stop, f);
      } else {
        for (int y = start; y <= stop; ++y) ForCells(y, k, k, f);
      }
    }
  }
  const std::vector<int>& wide() const { return wide_; }

 private:
  int count(int axis) const { return axis == 0 ? columns_ : rows_; }
  int Cell(double value, int axis) const {
    const double k = std::floor((value - low_[axis]) / cell_[axis]);
    return static_cast<int>(std::clamp(k, 0.0, static_cast<double>(count(axis) - 1)));
  }
  template <typename Function>
  void ForCells(int y, int left, int right, Function f) const {
    const auto row = static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_);
    const std::size_t end = start_[row + static_cast<std::size_t>(right) + 1];
    for (std::size_t k = start_[row + static_cast<std::size_t>(left)]; k < end; ++k) {
      f(static_cast<std::size_t>(order_[k]));
    }
  }

  bool window_ = false;
  bool has_grid_ = false;
  Eigen::Vector3d center_;
  std::vector<Eigen::Vector2d> xy_;
  std::vector<Eigen::Matrix2d> cov_, weight_;
  std::vector<double> log_det_, sigma_;
  std::vector<char> valid_;
  std::vector<Eigen::Vector3d> origin_, direction_;
  std::vector<Eigen::Matrix<double, 3, 2>> origin_by_, direction_by_;
  std::vector<int> wide_;  // far less sure than the others: in no cell
  double max_sigma_ = 0.0;
  Eigen::Vector2d low_, cell_;
  int columns_ = 0, rows_ = 0;
  std::vector<std::size_t> start_;
  std::vector<int> order_, cell_of_;
};

/// A point from the targets of several cameras.
struct PointEstimate {
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();  ///< inverse of its covariance
  double chi2 = 0.0;

  Eigen::Matrix3d cov_mm2() const;
};

/// The point nearest to two rays; false if they are parallel or it is behind.
bool MeetingPoint(const TargetView& a, std::size_t i, const TargetView& b, std::size_t j,
                  Eigen::Vector3d* position_mm);

/// Least squares of the residuals in the normalised pictures from a start value:
/// Gauss-Newton as Intersect, to a hundredth of a standard deviation.
/// @return false if the point goes behind a camera or is not determined.
bool AdjustPoint(const std::vector<CameraView>& cameras, const std::vector<TargetView>& targets,
                 std::span<const ViewTarget> used, PointEstimate* point);

}  // namespace videogrammetry
