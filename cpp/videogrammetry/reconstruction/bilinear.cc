#include "videogrammetry/reconstruction/bilinear.h"

#include <algorithm>
#include <stdexcept>

namespace videogrammetry {
namespace {

struct Place {
  std::size_t node;
  double share;  // of the way to the next one
};

Place PlaceOf(double value, double last_px, int count) {
  const double at = std::clamp(value / last_px, 0.0, 1.0) * (count - 1);
  const int node = std::min(static_cast<int>(at), count - 2);
  return {static_cast<std::size_t>(node), at - node};
}

}  // namespace

std::vector<double> Bilinear(const PictureNodes& nodes, std::span<const double> xy_px) {
  if (nodes.columns < 2 || nodes.rows < 2 ||
      nodes.values.size() !=
          3 * static_cast<std::size_t>(nodes.columns) * static_cast<std::size_t>(nodes.rows)) {
    throw std::invalid_argument("nodes: expected (rows, columns, 3), two or more of each");
  }
  const std::size_t stride = 3 * static_cast<std::size_t>(nodes.columns);
  std::vector<double> result(xy_px.size() / 2 * 3);
  for (std::size_t i = 0; i < xy_px.size() / 2; ++i) {
    const double x = xy_px[2 * i], y = xy_px[2 * i + 1];
    if (!(x == x && y == y)) {
      std::fill_n(&result[3 * i], 3, x + y);
      continue;
    }
    const Place u = PlaceOf(x, nodes.width_px - 1, nodes.columns);
    const Place v = PlaceOf(y, nodes.height_px - 1, nodes.rows);
    const double* node = &nodes.values[v.node * stride + 3 * u.node];
    for (std::size_t k = 0; k < 3; ++k) {
      const double upper = (1 - u.share) * node[k] + u.share * node[k + 3];
      const double lower = (1 - u.share) * node[k + stride] + u.share * node[k + stride + 3];
      result[3 * i + k] = (1 - v.share) * upper + v.share * lower;
    }
  }
  return result;
}

}  // namespace videogrammetry
