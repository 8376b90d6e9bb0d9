#include "videogrammetry/adjustment/linearise.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "videogrammetry/adjustment/observation_model.h"

namespace videogrammetry {
namespace {

ImageRow MakeRow(const Network& network, int image_index, const UnknownIndex& index, int point,
                 const std::optional<Eigen::Vector2d>& pixel, const ImagePointJacobians& j) {
  const NetworkImage& image = network.images[image_index];
  ImageRow row;
  if (!pixel) return row;
  row.valid = true;
  row.pixel = *pixel;
  auto add = [&](int unknown, const Eigen::Vector2d& column) {
    row.design.col(row.size) = column;
    row.unknown[row.size++] = unknown;
  };
  for (int k = 0; k < kNumCameraUnknowns; ++k) {
    const int u = index.camera[image.camera][k];
    if (u >= 0) add(u, j.by_camera.col(k));
  }
  const int outer = image.outer < 0 ? -1 : index.pose[image.outer], inner = index.pose[image.inner];
  for (int k = 0; outer >= 0 && k < 6; ++k) add(outer + k, j.by_outer.col(k));
  for (int k = 0; inner >= 0 && k < 6; ++k) add(inner + k, j.by_inner.col(k));
  const int window = network.cameras[image.camera].interface;
  if (window >= 0) {
    Eigen::Matrix<double, 3, 2> normal_by_tilt;
    network.interfaces[window].surface(&normal_by_tilt);
    Eigen::Matrix<double, 2, kNumInterfaceUnknowns> by_interface;
    by_interface << j.by_normal * normal_by_tilt, j.by_distance;
    for (int k = 0; k < kNumInterfaceUnknowns; ++k) {
      const int u = index.interface[window][k];
      if (u >= 0) add(u, by_interface.col(k));
    }
  }
  for (int k = 0; index.point[point] >= 0 && k < 3; ++k) {
    add(index.point[point] + k, j.by_point.col(k));
  }
  return row;
}

}  // namespace

ImageRow LineariseImagePoint(const Network& network, const UnknownIndex& index, int image,
                             int point, const Eigen::Vector2d& velocity_px) {
  ImagePointJacobians j;
  const auto pixel = PredictImagePoint(network, image, point, velocity_px, &j);
  return MakeRow(network, image, index, point, pixel, j);
}

ImageRow LineariseObservation(const Network& network, const UnknownIndex& index,
                              const NetworkObservation& o) {
  ImagePointJacobians j;
  const auto pixel = PredictObservation(network, o, &j);
  return MakeRow(network, o.image, index, o.point, pixel, j);
}

BarRow LineariseBar(const Network& network, const UnknownIndex& index, const NetworkScaleBar& bar) {
  const Eigen::Vector3d between =
      network.points[bar.a].position_mm - network.points[bar.b].position_mm;
  BarRow row;
  row.length_mm = between.norm();
  const Eigen::Vector3d along = between / std::max(row.length_mm, 1e-300);
  for (const auto& [point, sign] : {std::pair(bar.a, 1.0), std::pair(bar.b, -1.0)}) {
    for (int k = 0; index.point[point] >= 0 && k < 3; ++k) {
      row.design[row.size] = sign * along[k];
      row.unknown[row.size++] = index.point[point] + k;
    }
  }
  return row;
}

}  // namespace videogrammetry
