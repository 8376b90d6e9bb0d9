#pragma once

#include <array>
#include <vector>

#include "videogrammetry/core/cpu.h"
#include "videogrammetry/recognition/contour.h"
#include "videogrammetry/recognition/grey_window.h"

namespace videogrammetry {

/// A closed bright area of a picture that may be a dot.
struct DotRegion {
  ContourMoments moments;  ///< of its pixels, those at or above `level`
  float inside = 0.0f;     ///< grey value of the dot, with the polarity's sign
  float outside = 0.0f;    ///< and of its surroundings
  float level() const { return 0.5f * (inside + outside); }
};

/// Finds the areas of a picture that may be dots by pairs of edges along its rows.
///
/// @param sign  +1: dots are bright, -1: dark.
/// @param diameter_px  smallest minor and largest major axis, full lengths.
/// @return in the order of the rows, then of the columns, of their first chord.
std::vector<DotRegion> FindDotRegions(const FrameView& frame, int sign,
                                      const std::array<double, 2>& diameter_px,
                                      InstructionSet set = DetectInstructionSet());

}  // namespace videogrammetry
