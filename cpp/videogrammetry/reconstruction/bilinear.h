#pragma once

#include <span>
#include <vector>

namespace videogrammetry {

/// Three values at nodes that are spread evenly over a picture, from the middle of its
/// corner pixels to the middle of those opposite.
struct PictureNodes {
  std::span<const double> values;  ///< row by row, three a node
  int columns = 0, rows = 0;       ///< two at least
  double width_px = 0.0, height_px = 0.0;
};

/// The values at pixels (x, y of one after the other), linear between the nodes along x and
/// along y; outside the picture those of its edge. Three a pixel.
/// @throws std::invalid_argument if the nodes' number does not fit or there are too few.
std::vector<double> Bilinear(const PictureNodes& nodes, std::span<const double> xy_px);

}  // namespace videogrammetry
