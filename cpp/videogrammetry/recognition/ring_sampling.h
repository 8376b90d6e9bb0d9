#pragma once

#include <array>

#include "videogrammetry/recognition/code_family.h"
#include "videogrammetry/recognition/grey_sampler.h"
#include "videogrammetry/recognition/target_edge.h"

namespace videogrammetry {

/// Samples a sector and circle: on the ring, and beside it or for a first look.
inline constexpr int kRingPerSector = 8;
inline constexpr int kBesidePerSector = 4;

/// Values of one circle on the ring, or of one beside it; the first ones are used.
using RingCircle = std::array<float, kRingPerSector * kMaxCodeBits>;
using BesideCircle = std::array<float, kBesidePerSector * kMaxCodeBits>;

/// Grey values around a dot where its code ring would be, as v = (I - outside)
/// / (inside - outside): 0 like the dot's surroundings, 1 like the dot. A place
/// outside the picture is NaN.
///
/// Sample i of sector k stands at [kRingPerSector k + i], at the part (i + 1/2) /
/// kRingPerSector of the sector (beside the ring: kBesidePerSector).
struct RingSamples {
  int num_bits = 0;
  RingCircle inner;      ///< 0.2 of the ring's width from its inner border
  RingCircle middle;     ///< in its middle
  RingCircle outer;      ///< 0.2 of its width from its outer border
  BesideCircle outside;  ///< 0.2 of its width beyond the ring
  /// Of each sector: the blur (a standard deviation) over the sector's length in
  /// the middle of the ring, and over the ring's width.
  std::array<float, kMaxCodeBits> blur_along = {}, blur_across = {};
  /// Of each sector: its length in the middle of the ring, in pixels.
  std::array<float, kMaxCodeBits> length_px = {};
  /// Standard deviation of an edge's place where one profile is measured, in pixels.
  float edge_sigma_px = 0.0f;
  /// The same of a grey value between pixels.
  float grey_sigma = 0.0f;
};

/// Places around a dot: x = c + rho E u. The dot's ellipse maps the ring (affine:
/// what is a circle about the dot in space is, close enough, the ellipse
/// magnified: perspective moves the ring by about 9 r sin(tilt) / f of the dot's
/// radius r in pixels and the camera's f, 3 % for 20 px and 3000 px at 45 degrees,
/// most of it along the ring's spokes). u(t) = (cos t, sin t) runs from x towards
/// y, clockwise in the picture.
class RingSampler {
 public:
  RingSampler(const GreySampler& picture, const TargetEdge& dot, const CodeFamily& family);

  /// A first look: the ring's middle at kBesidePerSector directions a sector, the
  /// first at t = 0, without half a step.
  /// @return false if the picture ends there.
  bool Middle(BesideCircle* values) const;
  /// The ring's middle at kBesidePerSector places a sector, the first sector beginning `phase`
  /// sectors after t = 0.
  /// @return false if the picture ends there.
  bool MiddleFrom(double phase, BesideCircle* values) const;
  /// Between dot and ring, at the directions of Middle.
  void Gap(BesideCircle* values) const;
  /// All around, the first sector beginning `phase` sectors after t = 0.
  /// @return false if the picture ends before the ring's inner circle.
  bool Sample(double phase, RingSamples* samples) const;
  /// The largest factor by which a blurred dot may be larger than it was measured.
  double LargestScale() const;
  /// Takes the dot to be larger by a factor.
  void Scale(double factor);

 private:
  struct Turned;
  bool Circle(const Turned& turned, double radius, int per_sector, float* values) const;

  const GreySampler& picture_;
  const CodeFamily& family_;
  double x_, y_;              ///< centre
  double xx_, xy_, yy_;       ///< E
  double reach_x_, reach_y_;  ///< of the ellipse
  float outside_, scale_;     ///< v = (I - outside) scale
  double blur_px_, edge_sigma_px_;
  bool exact_axes_;
};

}  // namespace videogrammetry
