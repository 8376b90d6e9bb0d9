#include "videogrammetry/geometry/half_spaces.h"

#include <stdexcept>

namespace videogrammetry {

std::vector<char> InsideHalfSpaces(std::span<const double> points, std::span<const double> planes,
                                   double border) {
  if (points.size() % 3 != 0 || planes.size() % 4 != 0) {
    throw std::invalid_argument("expected points (N, 3) and planes (F, 4)");
  }
  const std::size_t count = planes.size() / 4;
  // Coordinate by coordinate, so that several planes are looked at at once.
  std::vector<double> nx(count), ny(count), nz(count), reach(count);
  for (std::size_t f = 0; f < count; ++f) {
    nx[f] = planes[4 * f];
    ny[f] = planes[4 * f + 1];
    nz[f] = planes[4 * f + 2];
    reach[f] = border - planes[4 * f + 3];
  }
  std::vector<char> inside(points.size() / 3);
  for (std::size_t i = 0; i < inside.size(); ++i) {
    const double x = points[3 * i], y = points[3 * i + 1], z = points[3 * i + 2];
    long long outside = 0;
    for (std::size_t f = 0; f < count; ++f) {
      outside |= nx[f] * x + ny[f] * y + nz[f] * z <= reach[f] ? 0LL : 1LL;
    }
    inside[i] = outside == 0 ? 1 : 0;
  }
  return inside;
}

}  // namespace videogrammetry
