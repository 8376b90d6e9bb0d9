#pragma once

#include <vector>

#include "videogrammetry/geometry/conic.h"
#include "videogrammetry/recognition/signed_image.h"

namespace videogrammetry {

/// A pixel on a single-pixel edge.
struct EdgePixel {
  int x = 0, y = 0;
  float normal_x = 0.0f, normal_y = 0.0f;  ///< unit vector from bright to dark
};

/// Canny's edges in the surroundings of a candidate: step 3 of the local Canny.
///
/// Sobel gradients, suppression of all that is no maximum along the gradient,
/// hysteresis. Only pixels near the candidate's ellipse count, and only edges
/// whose bright side lies inside. Both thresholds come from the place itself:
/// 1/2 and 1/4 of the median gradient along the ellipse.
///
/// @param band_px  distance from the ellipse within which edges are looked for.
template <typename T>
std::vector<EdgePixel> LocalCanny(const SignedImage<T>& image, const Ellipse& ellipse,
                                  double band_px);

}  // namespace videogrammetry
