#pragma once

// Private to the edge-pair search: where borders of areas have been met.

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace videogrammetry::edge_pair {

/// How often a left border of an area passed a pixel of the scanned rows, for the rows
/// that areas begun so far can reach: a ring of rows with two bits a pixel.
class BorderVisits {
 public:
  BorderVisits(int width, int num_rows)
      : words_(static_cast<std::size_t>(width) / 64 + 1),
        num_rows_(std::bit_ceil(static_cast<std::size_t>(num_rows))),
        once_(words_ * num_rows_),
        enough_(words_ * num_rows_) {}

  /// @param row  index among the scanned rows.
  void Mark(int row, int x, bool accepted) {
    const std::size_t at = At(row) + static_cast<std::size_t>(x) / 64;
    const std::uint64_t bit = std::uint64_t{1} << (x & 63);
    enough_[at] |= accepted ? bit : once_[at] & bit;
    once_[at] |= bit;
  }

  /// True if a border at first ... last belongs to an accepted area, or was met twice.
  bool SeenEnough(int row, int first, int last) const {
    const std::size_t begin = At(row);
    const auto from = static_cast<std::size_t>(first), to = static_cast<std::size_t>(last);
    std::uint64_t hit = 0;
    for (std::size_t i = from / 64; i <= to / 64; ++i) {
      std::uint64_t bits = enough_[begin + i];
      if (i == from / 64) bits &= ~std::uint64_t{0} << (from & 63);
      if (i == to / 64) bits &= ~std::uint64_t{0} >> (63 - (to & 63));
      hit |= bits;
    }
    return hit != 0;
  }

  /// Gives a row's place to the one that comes `num_rows` later.
  void Leave(int row) {
    const auto begin = static_cast<std::ptrdiff_t>(At(row));
    const auto words = static_cast<std::ptrdiff_t>(words_);
    std::fill_n(once_.begin() + begin, words, 0);
    std::fill_n(enough_.begin() + begin, words, 0);
  }

 private:
  std::size_t At(int row) const {
    return (static_cast<std::size_t>(row) & (num_rows_ - 1)) * words_;
  }

  std::size_t words_, num_rows_;  // the latter a power of two, so that At() needs no division
  std::vector<std::uint64_t> once_, enough_;
};

}  // namespace videogrammetry::edge_pair
