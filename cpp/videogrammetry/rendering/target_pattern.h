#pragma once

#include <cstdint>
#include <vector>

#include "videogrammetry/rendering/scene.h"

namespace videogrammetry {

/// What a cell of the picture sees of a target, as shares of its area.
struct Coverage {
  float sticker = 0.0f;  ///< of the whole target
  float mark = 0.0f;     ///< of the dot and the bright sectors; part of `sticker`
  bool cut = false;      ///< a border runs through the cell; else the moments are 0
  /// First moments of both shares about the cell's middle, in cells, along x and y.
  float sticker_x = 0.0f, sticker_y = 0.0f, mark_x = 0.0f, mark_y = 0.0f;
};

/// Corner coordinates of a cell in the target's plane, in radii of the dot;
/// between them the plane's coordinates are taken as bilinear.
struct CellCorners {
  float u00, v00, u10, v10, u01, v01, u11, v11;  ///< first digit: along x
};

/// The printed pattern of a target, in its plane, unit = radius of the dot.
class TargetPattern {
 public:
  explicit TargetPattern(const SceneTarget& target);

  /// Shares of a cell's area. A cell that no border crosses is answered from
  /// its middle; the others are cut by `lines` straight lines, across which the
  /// nearest border runs, and each line's share is exact: with the border
  /// crossing at s, the error is of the order of (s'' + kink) / (8 lines^2).
  Coverage Over(const CellCorners& cell, int lines) const;

 private:
  struct Crossed;  // the borders that may run through a cell
  struct Cuts;     // where a line crosses them

  Coverage At(float u, float v, const Crossed& crossed) const;
  Crossed BordersOf(float u, float v, float reach) const;
  void AddCuts(float u, float v, float du, float dv, const Crossed& crossed, Cuts* cuts) const;
  Coverage CutByLines(const CellCorners& cell, const Crossed& crossed, int lines) const;
  bool Bright(int sector) const { return (code_ >> (num_bits_ - 1 - sector)) & 1u; }
  int SectorOf(float u, float v) const;

  float sticker_;
  bool square_;
  float inner_ = 0, outer_ = 0;
  int num_bits_;
  std::uint32_t code_;
  std::vector<float> cos_, sin_;  // of the sectors' first borders
};

}  // namespace videogrammetry
