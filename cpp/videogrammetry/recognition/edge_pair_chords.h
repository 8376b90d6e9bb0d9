#pragma once

// Private to the edge-pair search: the chords of a row.

#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "videogrammetry/recognition/edge_pair_kernels.h"

namespace videogrammetry::edge_pair {

/// Last bit of a rise and first of the fall after it, without another edge between.
struct Pair {
  int rise, fall;
  int length() const { return fall - rise; }
};

/// The pairs of a scanned row from left to right.
///
/// In clutter nothing about the next pair is to be foreseen, and a wrong guess of the
/// processor costs more than everything else here: so there are few decisions, and work
/// that turns out to be in vain is done all the same.
class RowPairs {
 public:
  explicit RowPairs(int width) {
    const auto most = static_cast<std::size_t>(width / 2 + 2 * kBlock);
    rises_.resize(most);
    falls_.resize(most);
    Clear();
  }

  int count() const { return count_; }
  Pair operator[](int i) const {
    return {rises_[static_cast<std::size_t>(i)], falls_[static_cast<std::size_t>(i)]};
  }

  void Clear() {
    count_ = 0;
    Pad();
  }

  /// Takes the pairs of up to `max_length` from a row's words; `which` of them, `found` in
  /// number, have bits. No bit is in both.
  void Find(const std::uint64_t* rises, const std::uint64_t* falls, const int* which, int found,
            int max_length) {
    Writer writer{rises_.data(), falls_.data(), max_length};
    std::uint64_t open = 0;  // 1 if the last edge before this word is a rise
    int last_edge = -1;      // in the words before
    for (int j = 0; j < found; ++j) {
      const int base = 64 * which[j];
      const std::uint64_t rise = rises[which[j]], fall = falls[which[j]], edges = rise | fall;
      // A one that is added where a gap begins after a rise is carried to the gap's end:
      // the next edge.
      const std::uint64_t after = rise << 1 | open, gaps = ~edges;
      const std::uint64_t sum = gaps + (after & gaps);
      std::uint64_t closing = ((sum & edges) | after) & fall;
      open = rise >> 63 | static_cast<std::uint64_t>(sum < gaps);
      // (mostly there are two at most)
      writer.Put(closing, edges, base, last_edge);
      closing &= closing - 1;
      writer.Put(closing, edges, base, last_edge);
      closing &= closing - 1;
      for (; closing != 0; closing &= closing - 1) {
        writer.Put(closing, edges, base, last_edge);
      }
      last_edge = base + 63 - std::countl_zero(edges);
    }
    count_ = writer.count;
    Pad();
  }

  /// For the kernels.
  PairList list() const { return {rises_.data(), falls_.data(), count_}; }

 private:
  static constexpr int kBlock = PairList::kBlock;

  /// Apart from the row, so that all of it stays in registers.
  struct Writer {
    int* rises;
    int* falls;
    int max_length;
    int count = 0;

    // The pair that ends with the lowest bit of `closing`, if there is one.
    void Put(std::uint64_t closing, std::uint64_t edges, int base, int last_edge) {
      constexpr std::uint64_t kLast = std::uint64_t{1} << 63;
      const int bit = std::countr_zero(closing | kLast);
      const std::uint64_t below = edges & ((std::uint64_t{1} << bit) - 1);
      const int inside = base + 63 - std::countl_zero(below | 1);
      const int edge = below != 0 ? inside : last_edge;
      rises[count] = edge;
      falls[count] = base + bit;
      count += static_cast<int>(closing != 0) & static_cast<int>(base + bit - edge <= max_length);
    }
  };

  // Up to a whole block, with what overlaps nothing.
  void Pad() {
    for (int i = count_; i < count_ + kBlock; ++i) {
      rises_[static_cast<std::size_t>(i)] = std::numeric_limits<int>::max() / 2;
      falls_[static_cast<std::size_t>(i)] = -1;
    }
  }

  int count_ = 0;
  std::vector<int> rises_, falls_;
};

}  // namespace videogrammetry::edge_pair
