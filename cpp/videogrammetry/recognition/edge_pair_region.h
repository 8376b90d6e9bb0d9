#pragma once

// Private to the edge-pair search: the area around a pixel, row by row.

#include <array>
#include <cstdint>
#include <vector>

#include "videogrammetry/recognition/contour.h"
#include "videogrammetry/recognition/edge_pair_samples.h"

namespace videogrammetry::edge_pair {

/// A run of pixels of a row.
struct Run {
  int left = 0, right = -1;
  bool empty() const { return right < left; }
};

/// Grows the area of values at or above a level around a pixel, upwards and
/// downwards: a row's part is what lies between the ends of the runs that touch the
/// next row's part. For a convex area, holes or not, that is the 4-connected one;
/// of any other shape it may be a part, which the caller's test of shape must
/// refuse. Keeps its memory from one area to the next.
class RegionGrower {
 public:
  /// @param max_extent_px  an area wider or higher than this is given up.
  RegionGrower(const SampleRows& rows, int max_extent_px);

  /// @return true if the area is closed, within the extent and not ragged: see
  ///     ContourFollower.
  ///
  /// @param length_px  of the row's part, about: for one longer than 16 px a few rows tell
  ///     first whether it is worth to go through all of them.
  bool Grow(int x, int y, int level, int length_px);

  ContourMoments Moments() const;  ///< after Grow() returned true
  /// Left end of the area in a row from top() to bottom(); also after a failure, of the
  /// rows met until then.
  int left_end(int y) const { return left_ends_[static_cast<std::size_t>(y - y0_ + reach_)]; }
  int top() const { return top_; }
  int bottom() const { return bottom_; }
  int left() const { return left_; }  ///< of the bounding box
  int right() const { return right_; }

 private:
  enum class Next { kRun, kEnd, kWider, kFailed };

  // Masks of one word a row around the start, a block at a time: that spares a call
  // for each row.
  static constexpr int kBlock = 12;
  struct Block {
    std::array<std::uint64_t, kBlock> masks;
    int first = 0, count = 0;
  };

  void Restart(int x, int y);
  Next Area(int x, int y);
  int RoughStep(int length_px) const;
  bool MayBeEllipse() const;
  void FillBetween(int y, int direction, const Run& last, const Run& run);
  Next Walk(int direction, Run last);
  Next Row(int y, int direction, const Run& last, Run* run);
  Next NarrowRow(int y, int direction, const Run& last, Run* run);
  Next WideRow(int y, const Run& last, Run* run) const;
  std::uint64_t Word(int y, int x) const;
  void Add(int y, const Run& run);
  bool IsRagged() const;

  const SampleRows& rows_;
  const int max_extent_;
  const int reach_;  ///< rows from the start that may be met
  std::vector<int> left_ends_;
  Block block_;
  bool wide_ = false;
  int step_ = 1;  ///< rows from one looked at to the next
  int x0_ = 0, y0_ = 0, level_ = 0, window_ = 0;
  int left_ = 0, right_ = 0, top_ = 0, bottom_ = 0;
  int sideways_ = 0;  ///< horizontal sides of the border
  // Sums over the pixels, from (x0_, y0_), times what makes them whole numbers.
  std::int64_t n_ = 0, sx2_ = 0, sy_ = 0, sxx12_ = 0, sxy2_ = 0, syy_ = 0;
};

}  // namespace videogrammetry::edge_pair
