#pragma once

#include <optional>
#include <vector>

#include "videogrammetry/recognition/signed_image.h"
#include "videogrammetry/recognition/target_edge.h"

namespace videogrammetry {

/// Grey values around a dot where its code ring would be, as v = (I - outside)
/// / (inside - outside): 0 like the dot's surroundings, 1 like the dot.
struct RingSamples {
  int per_sector = 0;
  std::vector<float> gap;      ///< between dot and ring
  std::vector<float> inner;    ///< near the ring's inner border
  std::vector<float> middle;   ///< in its middle
  std::vector<float> outer;    ///< near its outer border
  std::vector<float> outside;  ///< just beyond the ring
};

/// Samples at `count` directions of one radius, in radii of the dot.
///
/// The dot's ellipse maps the ring (affine: what is a circle about the dot in
/// space is, close enough, the ellipse magnified): x = c + rho E u. The
/// directions u(t) = (cos t, sin t) run from x towards y, clockwise in the picture.
/// A sample outside the picture is NaN.
template <typename T>
std::vector<float> SampleCircle(const SignedImage<T>& image, const TargetEdge& dot, double radius,
                                int count);

/// All five circles.
/// @return nullopt if the picture's border cuts the ring's inner part.
template <typename T>
std::optional<RingSamples> SampleRing(const SignedImage<T>& image, const TargetEdge& dot,
                                      double ring_inner, double ring_outer, int num_bits);

}  // namespace videogrammetry
