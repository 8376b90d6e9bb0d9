#pragma once

// Private to the edge-pair search: the same kernels for each instruction set. The
// files that define them are compiled with flags of their own, so nothing that is
// inlined elsewhere may be defined or instantiated in them.

#include <cstddef>
#include <cstdint>

namespace videogrammetry::edge_pair {

/// How the samples of a row lie in memory, and the kernels' place in their tables.
enum Storage { kBytes, kWords, kPackedHighFirst, kPackedLowFirst, kNumStorages };

/// Chords of a row from left to right, none of which overlap. Behind them lie kBlock more
/// that overlap nothing.
struct PairList {
  static constexpr int kBlock = 8;
  const int* rises;
  const int* falls;
  int count;
};

/// What a threshold grows by with the grey value I as stored:
/// min(most, max(0, I - from) * per_grey / 65536), rounded down; 0 <= all three < 65536.
struct Growth {
  int from, per_grey, most;
};

/// Kernels on rows of one storage. They read nothing but the row's own bytes.
struct Kernels {
  /// With g(i) = I(i + 2) - I(i), sets bit i % 64 of rises[i / 64] where g > threshold
  /// and that of falls[i / 64] where g < -threshold: bit i belongs to pixel i + 1. The
  /// indices of the words with any bit are written to `which`.
  /// @return how many words those are, of the (width + 61) / 64 written.
  int (*edges)(const std::uint8_t* row, int width, int threshold, std::uint64_t* rises,
               std::uint64_t* falls, int* which);
  /// Of the `found` words in `which` keeps those edges that exceed the threshold by what it
  /// grows by at the brighter of the two samples.
  /// @return how many words with any are left in `which`.
  int (*brighter)(const std::uint8_t* row, int width, int threshold, Growth growth,
                  std::uint64_t* rises, std::uint64_t* falls, int* which, int found);
  /// Copies samples, combined with `flip` by exclusive or; x is even. May write up to
  /// kSampleSlack values more.
  void (*samples)(const std::uint8_t* row, int width, int x, int count, std::uint16_t flip,
                  std::uint16_t* out);
  /// How many of `count` values are at most `limit`; count < 65536.
  int (*count_up_to)(const std::uint16_t* values, int count, std::uint16_t limit);
  /// Writes the numbers of the pairs that are longer than those above (or as long) and not
  /// shorter than those below, of those that overlap and are no more than about twice as
  /// long: such are of another area. A pair of `long_px` or more must have one of half its
  /// length or more beside it on both sides.
  /// @return how many those are.
  int (*longest)(PairList pairs, PairList above, PairList below, int long_px, int* numbers);
};
constexpr int kSampleSlack = 32;

/// Tables of kNumStorages entries.
const Kernels* BaselineKernels();
const Kernels* Avx2Kernels();
const Kernels* Avx512Kernels();

}  // namespace videogrammetry::edge_pair
