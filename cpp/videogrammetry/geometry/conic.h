#pragma once

#include <Eigen/Core>
#include <optional>

namespace videogrammetry {

/// An ellipse in the picture: pixel frame, (0, 0) the centre of the top-left
/// pixel, y down; the angle of the major axis runs from x towards y.
struct Ellipse {
  double x_px = 0.0;
  double y_px = 0.0;
  double semi_major_px = 0.0;
  double semi_minor_px = 0.0;
  double angle_rad = 0.0;  ///< in [0, pi)
};

/// Symmetric 3x3 matrix C with (x, y, 1) C (x, y, 1)^T = 0 on the ellipse,
/// negative inside, scaled so that C's upper-left block is (R D R^T) with
/// D = diag(1/a^2, 1/b^2).
Eigen::Matrix3d ConicFromEllipse(const Ellipse& ellipse);

/// The ellipse of a conic of any scale and sign.
/// @return nullopt if the conic is no real ellipse.
std::optional<Ellipse> EllipseFromConic(const Eigen::Matrix3d& conic);

}  // namespace videogrammetry
