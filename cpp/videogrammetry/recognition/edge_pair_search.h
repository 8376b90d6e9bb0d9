#pragma once

#include <array>
#include <vector>

#include "videogrammetry/core/cpu.h"
#include "videogrammetry/geometry/conic.h"
#include "videogrammetry/recognition/contour.h"
#include "videogrammetry/recognition/gradient_threshold.h"
#include "videogrammetry/recognition/grey_window.h"
#include "videogrammetry/recognition/place_index.h"

namespace videogrammetry {

/// A closed area of a picture that may be a dot: brighter (or darker) than its surroundings.
struct DotRegion {
  ContourMoments moments;  ///< of the ellipse that it is cut out as at `level`
  float inside = 0.0f;     ///< grey value of the dot, with the polarity's sign
  float outside = 0.0f;    ///< and of its surroundings
  float level() const { return 0.5f * (inside + outside); }
};

/// Finds the areas of a picture that may be dots by pairs of edges along its rows.
///
/// 1. Every k-th row is binarised on g(x) = I(x+1) - I(x-1), 64 pixels at once, from
///    the samples as they lie in memory; k is such that a circle of the smallest
///    diameter d is cut within d/4 of its centre.
/// 2. A rise followed by a fall without another edge between them is a chord. Of the
///    chords that lie below each other those are looked at that are longer than their
///    neighbours: of much the same ground on both sides. Long ones have chords of half their
///    length or more in the rows above and below.
/// 3. From the chord's middle the area's extent is followed in eight directions at the
///    grey value half-way between the chord's inside and its surroundings
///    (edge_pair_star.h). Accepted is what ends alike in opposite directions, obeys the
///    ellipse's relation between its diameters, and has axes within the given ones (a
///    pixel of freedom: they are judged after the fit), minor / major >= 0.18 (a tilt of
///    79 degrees).
///
/// The level is the chord's own, so a dot with a dark rim is an area of its own on a
/// background brighter than itself. A dot may be found several times, from other rows and at
/// other levels: the caller leaves out what it has measured before. Segments of ring codes may be
/// areas too. The moments are those of the ellipse, good to some tenths of a pixel.
///
/// Time and memory: a chord is followed no further than 2.5 times its length and along
/// eight lines; of three rows the edges are kept, nothing of the picture is copied.
/// Frames in 8 bit, 16 bit and packed 12 bit with the same values give the same areas,
/// and so does every instruction set, bit for bit.
///
/// @param sign  +1: dots are bright, -1: dark.
/// @param diameter_px  smallest minor and largest major axis, full lengths;
///     3 <= min < max <= 2000 as in RecognitionOptions.
/// @param threshold  GradientThreshold of SampleGreyStatistics, or ThresholdByNoise.
/// @return in the order of the rows, then of the columns, of their first chord; empty for
///     a picture narrower or lower than 3 pixels.
std::vector<DotRegion> FindDotRegions(const FrameView& frame, int sign,
                                      const std::array<double, 2>& diameter_px,
                                      EdgeThreshold threshold,
                                      InstructionSet set = DetectInstructionSet());

/// A part of a picture: the pixels left ... right, top ... bottom, inclusive.
struct SearchWindow {
  int left = 0, top = 0, right = -1, bottom = -1;
};

/// Parts of a picture where all is known already: ellipses, some radii wide.
class KnownParts {
 public:
  KnownParts(int width, int height) : index_(width, height) {}  ///< of the picture

  void Add(const Ellipse& ellipse, double radii);
  bool Holds(double x_px, double y_px) const;
  bool empty() const { return parts_.empty(); }

 private:
  struct Part {
    double x, y, sxx, sxy, syy;
  };

  std::vector<Part> parts_;
  double reach_px_ = 0.0;
  PlaceIndex index_;
};

/// The same in parts of the picture: the areas that have a chord there, from the rows that
/// the whole picture's search looks at. Where windows overlap, an area may come twice.
///
/// @param known  may be null; chords whose middle is in there are passed over.
std::vector<DotRegion> FindDotRegions(const FrameView& frame, int sign,
                                      const std::array<double, 2>& diameter_px,
                                      EdgeThreshold threshold,
                                      const std::vector<SearchWindow>& windows,
                                      const KnownParts* known = nullptr,
                                      InstructionSet set = DetectInstructionSet());

/// The same with the frame's own threshold.
std::vector<DotRegion> FindDotRegions(const FrameView& frame, int sign,
                                      const std::array<double, 2>& diameter_px,
                                      InstructionSet set = DetectInstructionSet());

}  // namespace videogrammetry
