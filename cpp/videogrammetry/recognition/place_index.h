#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace videogrammetry {

/// Places in a picture with numbers, found again by where they are: in time that
/// grows with what is near, not with how many there are.
class PlaceIndex {
 public:
  PlaceIndex(int width, int height) : columns_(width / kCellPx + 1), rows_(height / kCellPx + 1) {
    first_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), -1);
  }

  void Insert(double x_px, double y_px, int number) {
    int& first = first_[At(Cell(x_px, columns_), Cell(y_px, rows_))];
    places_.push_back({x_px, y_px, number, first});
    first = static_cast<int>(places_.size()) - 1;
  }

  /// Calls visit(number) for every place within `reach_px` of (x, y) in both
  /// coordinates; true as soon as one says true.
  template <typename Visit>
  bool AnyNear(double x_px, double y_px, double reach_px, Visit&& visit) const {
    const int last_column = Cell(x_px + reach_px, columns_);
    const int last_row = Cell(y_px + reach_px, rows_);
    for (int j = Cell(y_px - reach_px, rows_); j <= last_row; ++j) {
      for (int i = Cell(x_px - reach_px, columns_); i <= last_column; ++i) {
        for (int k = first_[At(i, j)]; k >= 0; k = places_[static_cast<std::size_t>(k)].next) {
          const Place& place = places_[static_cast<std::size_t>(k)];
          if (std::abs(place.x - x_px) > reach_px || std::abs(place.y - y_px) > reach_px) continue;
          if (visit(place.number)) return true;
        }
      }
    }
    return false;
  }

 private:
  struct Place {
    double x, y;
    int number;
    int next;  ///< in the same cell, or -1
  };

  static constexpr int kCellPx = 32;
  /// Beyond the picture: the cell at its border.
  static int Cell(double v, int count) {
    return static_cast<int>(std::clamp(v / kCellPx, 0.0, static_cast<double>(count - 1)));
  }
  std::size_t At(int i, int j) const {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(i);
  }

  int columns_, rows_;
  std::vector<int> first_;  ///< of each cell, or -1
  std::vector<Place> places_;
};

}  // namespace videogrammetry
