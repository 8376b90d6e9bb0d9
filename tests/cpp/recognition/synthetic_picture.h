#pragma once

#include <cstdint>
#include <vector>

#include "videogrammetry/core/image_view.h"
#include "videogrammetry/geometry/conic.h"

namespace videogrammetry::testing {

/// What stands in a synthetic picture: an ellipse of grey `level`, perhaps with a ring.
struct Drawn {
  Ellipse ellipse;
  std::vector<int> bits;  ///< of the ring, clockwise; empty: none
  double turn_rad = 0.0;  ///< where the first sector begins
  double ring_inner = 2.0, ring_outer = 3.0;
};

/// A picture in memory.
template <typename T>
struct Picture {
  int width = 0, height = 0;
  std::vector<T> pixels;

  ImageView<T> view() const { return {pixels.data(), width, height}; }
};

/// Renders bright shapes on dark ground: coverage from 8 x 8 points a pixel,
/// blurred with the binomial (1 2 1) / 4 in both directions (variance 1/2 px^2),
/// with normal noise of a fixed seed.
Picture<std::uint16_t> Render(int width, int height, const std::vector<Drawn>& shapes,
                              double bright = 3000.0, double dark = 300.0, double noise_sigma = 0.0,
                              unsigned seed = 1);

/// Most significant bit first.
std::vector<int> Bits(std::uint32_t code, int num_bits);

}  // namespace videogrammetry::testing
