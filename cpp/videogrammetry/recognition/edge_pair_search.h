#pragma once

#include <array>
#include <vector>

#include "videogrammetry/core/cpu.h"
#include "videogrammetry/recognition/contour.h"
#include "videogrammetry/recognition/grey_window.h"

namespace videogrammetry {

/// A closed area of a picture that may be a dot: brighter (or darker) than its surroundings.
struct DotRegion {
  ContourMoments moments;  ///< of its pixels, those at or above `level`
  float inside = 0.0f;     ///< grey value of the dot, with the polarity's sign
  float outside = 0.0f;    ///< and of its surroundings
  float level() const { return 0.5f * (inside + outside); }
};

/// Finds the areas of a picture that may be dots by pairs of edges along its rows.
///
/// 1. Every k-th row is binarised on g(x) = I(x+1) - I(x-1), 64 pixels at once, from
///    the samples as they lie in memory; k is such that a circle of the smallest
///    diameter d is cut within d/4 of its centre.
/// 2. A rise followed by a fall without another edge between them is a chord: of the
///    right length, even inside, with much the same ground on both sides.
/// 3. The area around the chord's middle is grown at the grey value half-way between
///    the chord's inside and its surroundings (edge_pair_region.h). Accepted is what is
///    closed, away from the picture's border, not ragged, has axes within the diameters
///    (half a pixel of freedom at either end of an axis: they are judged after the edge
///    has been measured), minor / major >= 0.2 (a tilt of 78 degrees), and the area of
///    the ellipse with its second moments.
///
/// The level is the chord's own, so a dot with a dark rim is an area of its own on a
/// background brighter than itself. The areas overlap where a chord's level joins a dot
/// to what lies beside it, and a dot may rarely be found at two levels: the caller leaves out
/// what it has measured before. Segments of ring codes are areas too.
///
/// Time and memory: an area's left border is met at most twice (once if accepted), so
/// clutter costs a few steps a chord; the borders met are kept for as many rows only as
/// the largest diameter has. Nothing is copied but rows' parts of a chord's length.
/// Frames in 8 bit, 16 bit and packed 12 bit with the same values give the same areas,
/// and so does every instruction set, bit for bit.
///
/// @param sign  +1: dots are bright, -1: dark.
/// @param diameter_px  smallest minor and largest major axis, full lengths;
///     3 <= min < max <= 2000 as in RecognitionOptions.
/// @param gradient_threshold  GradientThreshold of SampleGreyStatistics.
/// @return in the order of the rows, then of the columns, of their first chord; empty for
///     a picture narrower or lower than 3 pixels.
std::vector<DotRegion> FindDotRegions(const FrameView& frame, int sign,
                                      const std::array<double, 2>& diameter_px,
                                      int gradient_threshold,
                                      InstructionSet set = DetectInstructionSet());

/// The same with the frame's own threshold.
std::vector<DotRegion> FindDotRegions(const FrameView& frame, int sign,
                                      const std::array<double, 2>& diameter_px,
                                      InstructionSet set = DetectInstructionSet());

}  // namespace videogrammetry
