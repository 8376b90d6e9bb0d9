#pragma once

#include <vector>

#include "videogrammetry/geometry/conic.h"
#include "videogrammetry/recognition/options.h"
#include "videogrammetry/recognition/signed_image.h"

namespace videogrammetry {

/// An area that may be a dot: closed, of the right size, roughly an ellipse.
struct Candidate {
  Ellipse ellipse;      ///< of the area's second moments, good to about half a pixel
  float inside = 0.0f;  ///< grey value of the dot, with the polarity's sign
  float level = 0.0f;   ///< grey value half-way to the surroundings
};

/// Finds the candidates of a picture: steps 1 and 2 of the local Canny.
///
/// 1. Every k-th row is binarised on its signed horizontal gradient
///    (gradient_mask.h); k is such that a dot of the smallest diameter is hit.
/// 2. A rise followed by a fall without another edge between them is a chord
///    of a bright area. From its left end the area's border is walked at the
///    grey value half-way between the chord's inside and its surroundings; the
///    walk ends early where the area is too large. Noise rules: closed, away
///    from the picture's border, axes within the diameters, not ragged, area
///    and second moments of an ellipse.
///
/// The level is the chord's own, so a dot with a dark rim is an area of its own
/// on a background brighter than itself, and clutter costs a few steps each.
/// The time is bounded: a pixel's border is walked at most twice.
///
/// @param gradient_threshold  see GradientThreshold.
template <typename T>
std::vector<Candidate> FindCandidates(const SignedImage<T>& image,
                                      const RecognitionOptions& options, int gradient_threshold);

}  // namespace videogrammetry
