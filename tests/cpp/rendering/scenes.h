#pragma once

#include <cmath>

#include "videogrammetry/rendering/render.h"

namespace videogrammetry::scenes {

/// A camera of the paper's kind at the origin, looking along z: all ten parameters.
inline OrientedCamera PaperCamera(DistortionDirection direction = DistortionDirection::kMeasured) {
  OrientedCamera camera;
  camera.camera.width_px = 1024;
  camera.camera.height_px = 1024;
  camera.camera.interior << 2650, -40, 30, 1.2e-8, 3e-15, 1e-20, 2e-7, 3e-6, -0.0023, 3e-4;
  camera.camera.r0_px = 400;
  camera.camera.direction = direction;
  return camera;
}

inline OrientedCamera Pinhole(int size_px = 256, double f_px = 2650) {
  OrientedCamera camera;
  camera.camera.width_px = camera.camera.height_px = size_px;
  camera.camera.interior[kF] = f_px;
  camera.camera.r0_px = 100;
  return camera;
}

/// A pose before a camera at the origin, its normal towards it, tilted about an
/// axis at `azimuth` of the picture and turned in its plane.
inline TargetPose Before(double x_mm, double y_mm, double z_mm, double tilt = 0, double azimuth = 0,
                         double turn = 0) {
  const Eigen::Matrix3d rotation = (Eigen::AngleAxisd(azimuth, Eigen::Vector3d::UnitZ()) *
                                    Eigen::AngleAxisd(tilt, Eigen::Vector3d::UnitX()) *
                                    Eigen::AngleAxisd(turn - azimuth, Eigen::Vector3d::UnitZ()))
                                       .toRotationMatrix();
  return {{x_mm, y_mm, z_mm}, -rotation.col(2), rotation.col(0)};
}

/// Centre and area of what is brighter than `dark`, by the moments of grey values.
struct Moments {
  Eigen::Vector2d center;
  double area;
};
inline Moments MomentsOf(const std::vector<float>& light, int width, double dark, double bright) {
  double sum = 0, x = 0, y = 0;
  for (std::size_t i = 0; i < light.size(); ++i) {
    const double value = (light[i] - dark) / (bright - dark);
    sum += value;
    x += value * static_cast<double>(i % width);
    y += value * static_cast<double>(i / width);
  }
  return {{x / sum, y / sum}, sum};
}

}  // namespace videogrammetry::scenes
