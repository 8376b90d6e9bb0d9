#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "videogrammetry/geometry/rig.h"
#include "videogrammetry/rendering/scene.h"

namespace videogrammetry {

/// A window of the picture in whole pixels: [x0, x1) x [y0, y1).
struct PixelWindow {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;

  int width() const { return x1 - x0; }
  int height() const { return y1 - y0; }
  bool empty() const { return x0 >= x1 || y0 >= y1; }
  bool Overlaps(const PixelWindow& o) const {
    return x0 < o.x1 && o.x0 < x1 && y0 < o.y1 && o.y0 < y1;
  }
};

/// Coordinates in a target's plane, in radii of the dot, at the corners of the
/// fine cells of a window: cell (i, j) of `scale` x `scale` cells a pixel has
/// the corners (i, j) ... (i + 1, j + 1).
struct PlaneLattice {
  int columns = 0, rows = 0;  ///< corners: width * scale + 1, height * scale + 1
  std::vector<float> u, v;    ///< row by row; NaN where no ray meets the plane
};

/// Meets the rays through a window's corners with a target's plane.
///
/// The chain pixel -> undistorted ray -> plane is followed exactly at nodes
/// kNodeSpacing apart and interpolated biquadratically between them: with D the
/// map's third derivative in px of the picture a px^3, the error is at most
/// D kNodeSpacing^3 / (9 sqrt(3)) a coordinate. For a plane tilted by t before a
/// camera of focal length f, D is about 6 (tan t / f)^2: 1e-6 px at 12 m and
/// 2650 px, 3e-4 px at 500 px and
/// 60 degrees, and 2e-3 px measured at a steeper ray at the border of that picture.
class LocalMap {
 public:
  static constexpr int kNodeSpacing = 4;

  LocalMap(const OrientedCamera& camera, const TargetPose& pose, double radius_mm);

  /// Coordinates in the plane of the ray through one pixel, without interpolation.
  std::optional<Eigen::Vector2d> At(const Eigen::Vector2d& pixel) const;

  PlaneLattice Over(const PixelWindow& window, int scale) const;

 private:
  const Camera* camera_;
  Eigen::Matrix3d plane_from_ray_;  ///< homography, in radii
};

}  // namespace videogrammetry
