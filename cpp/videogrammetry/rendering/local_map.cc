#include "videogrammetry/rendering/local_map.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <limits>

namespace videogrammetry {
namespace {

constexpr int kSpacing = LocalMap::kNodeSpacing;
constexpr int kTile = 2 * kSpacing;  // px: three nodes across

struct Nodes {
  int columns = 0, rows = 0;
  std::vector<double> u, v;
};

/// Lagrange's weights of the three nodes at 0, 1, 2.
std::array<double, 3> Weights(double t) {
  return {0.5 * (t - 1) * (t - 2), t * (2 - t), 0.5 * t * (t - 1)};
}

Nodes NodesOver(const LocalMap& map, const PixelWindow& window) {
  Nodes nodes;
  nodes.columns = 2 * ((window.width() + kTile - 1) / kTile) + 1;
  nodes.rows = 2 * ((window.height() + kTile - 1) / kTile) + 1;
  const auto count = static_cast<std::size_t>(nodes.columns) * nodes.rows;
  nodes.u.reserve(count);
  nodes.v.reserve(count);
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (int j = 0; j < nodes.rows; ++j) {
    for (int i = 0; i < nodes.columns; ++i) {
      const auto at = map.At({window.x0 - 0.5 + kSpacing * i, window.y0 - 0.5 + kSpacing * j});
      nodes.u.push_back(at ? at->x() : kNan);
      nodes.v.push_back(at ? at->y() : kNan);
    }
  }
  return nodes;
}

}  // namespace

LocalMap::LocalMap(const OrientedCamera& camera, const TargetPose& pose, double radius_mm)
    : camera_(&camera.camera) {
  const Eigen::Matrix3d& rotation = camera.cam_from_world.rotation;
  Eigen::Matrix3d ray_from_plane;  // (u, v, 1) -> point in the camera's frame
  ray_from_plane << rotation * pose.x_axis * radius_mm, rotation * pose.y_axis() * radius_mm,
      camera.cam_from_world * pose.center_mm;
  plane_from_ray_ = ray_from_plane.inverse();
}

std::optional<Eigen::Vector2d> LocalMap::At(const Eigen::Vector2d& pixel) const {
  const auto ray = RayThroughPixel(*camera_, pixel);
  if (!ray) return std::nullopt;
  const Eigen::Vector3d plane = plane_from_ray_ * *ray;
  // Depth along the ray is 1 / plane.z: a plane behind the camera is not met.
  if (!(plane.z() > 0)) return std::nullopt;
  return Eigen::Vector2d(plane.head<2>() / plane.z());
}

PlaneLattice LocalMap::Over(const PixelWindow& window, int scale) const {
  const Nodes nodes = NodesOver(*this, window);
  PlaneLattice lattice;
  lattice.columns = window.width() * scale + 1;
  lattice.rows = window.height() * scale + 1;
  const auto count = static_cast<std::size_t>(lattice.columns) * lattice.rows;
  lattice.u.resize(count);
  lattice.v.resize(count);
  const int fine_tile = kTile * scale;
  std::vector<std::array<float, 3>> across(static_cast<std::size_t>(fine_tile));
  for (int i = 0; i < fine_tile; ++i) {
    const auto w = Weights(static_cast<double>(i) / (kSpacing * scale));
    for (std::size_t k = 0; k < 3; ++k) across[i][k] = static_cast<float>(w[k]);
  }
  std::vector<float> line_u(static_cast<std::size_t>(nodes.columns)), line_v(line_u);
  for (int j = 0; j < lattice.rows; ++j) {
    const int tile = std::min(j / fine_tile, (nodes.rows - 3) / 2);
    const auto w = Weights(static_cast<double>(j - tile * fine_tile) / (kSpacing * scale));
    const double* u = nodes.u.data() + 2 * tile * nodes.columns;
    const double* v = nodes.v.data() + 2 * tile * nodes.columns;
    const int n = nodes.columns;
    for (int i = 0; i < n; ++i) {
      line_u[i] = static_cast<float>(w[0] * u[i] + w[1] * u[i + n] + w[2] * u[i + 2 * n]);
      line_v[i] = static_cast<float>(w[0] * v[i] + w[1] * v[i + n] + w[2] * v[i + 2 * n]);
    }
    float* out_u = lattice.u.data() + static_cast<std::size_t>(j) * lattice.columns;
    float* out_v = lattice.v.data() + static_cast<std::size_t>(j) * lattice.columns;
    for (int begin = 0, k = 0; begin < lattice.columns - 1; begin += fine_tile, k += 2) {
      const int end = std::min(begin + fine_tile, lattice.columns - 1);
      for (int i = begin; i < end; ++i) {
        const auto& a = across[i - begin];
        out_u[i] = a[0] * line_u[k] + a[1] * line_u[k + 1] + a[2] * line_u[k + 2];
        out_v[i] = a[0] * line_v[k] + a[1] * line_v[k + 1] + a[2] * line_v[k + 2];
      }
    }
    const int last = lattice.columns - 1, k = 2 * ((last - 1) / fine_tile);
    const auto a = Weights(static_cast<double>(last - k / 2 * fine_tile) / (kSpacing * scale));
    out_u[last] =
        static_cast<float>(a[0] * line_u[k] + a[1] * line_u[k + 1] + a[2] * line_u[k + 2]);
    out_v[last] =
        static_cast<float>(a[0] * line_v[k] + a[1] * line_v[k + 1] + a[2] * line_v[k + 2]);
  }
  return lattice;
}

}  // namespace videogrammetry
