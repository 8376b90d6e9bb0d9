#pragma once

#include <span>
#include <vector>

namespace videogrammetry {

/// Whether points lie in a convex body grown by a border: n_f . x + d_f <= border for all
/// of its planes.
///
/// @param points  x, y, z of one after the other.
/// @param planes  unit normal outwards and distance, four numbers a plane.
/// @return one a point, 1 or 0; 0 where a coordinate is not finite.
/// @throws std::invalid_argument if the lengths are no multiples of 3 and 4.
std::vector<char> InsideHalfSpaces(std::span<const double> points, std::span<const double> planes,
                                   double border);

}  // namespace videogrammetry
