#pragma once

#include <cmath>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace videogrammetry {

/// Places in a picture with numbers, found again by where they are: in time that
/// grows with what is near, not with how many there are.
class PlaceIndex {
 public:
  void Insert(double x_px, double y_px, int number) {
    cells_[Key(Cell(x_px), Cell(y_px))].push_back({x_px, y_px, number});
  }

  /// Calls visit(number) for every place within `reach_px` of (x, y) in both
  /// coordinates; true as soon as one says true.
  template <typename Visit>
  bool AnyNear(double x_px, double y_px, double reach_px, Visit&& visit) const {
    for (std::int64_t j = Cell(y_px - reach_px); j <= Cell(y_px + reach_px); ++j) {
      for (std::int64_t i = Cell(x_px - reach_px); i <= Cell(x_px + reach_px); ++i) {
        const auto cell = cells_.find(Key(i, j));
        if (cell == cells_.end()) continue;
        for (const Place& place : cell->second) {
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
  };

  static constexpr double kCellPx = 32.0;
  static std::int64_t Cell(double v) { return static_cast<std::int64_t>(std::floor(v / kCellPx)); }
  static std::uint64_t Key(std::int64_t i, std::int64_t j) {
    return static_cast<std::uint64_t>(j) << 32 ^ (static_cast<std::uint64_t>(i) & 0xffffffffu);
  }

  std::unordered_map<std::uint64_t, std::vector<Place>> cells_;
};

}  // namespace videogrammetry
