#pragma once

#include <span>
#include <vector>

#include "videogrammetry/geometry/intersection.h"
#include "videogrammetry/reconstruction/triangulate.h"

namespace videogrammetry {

/// G = -(J^T W J)^-1 J^T W A, the derivative of an intersected point by the parameters
/// of the cameras that see it, side by side in the order of the sightings.
/// @return false if a camera does not see the point.
bool Gain(const Rig& rig, std::span<const Sighting> sightings, const Intersection& point,
          Eigen::Matrix<double, 3, Eigen::Dynamic>* gain);

/// Displacement of a point by a small rotation and translation of the frame.
Eigen::Matrix<double, 3, 6> FrameEffect(const Eigen::Vector3d& x);

/// The calibration's part of points' covariance, prepared for many points.
///
/// With C = L L^T and the frame's motion M it is W W^T, W = G L - A (M L), of
/// which only the rows of L of the cameras that see the point are touched. L comes of the
/// eigenvalues of the correlations (parameters differ by 1e12 in size), as
/// many columns as are not zero: held parameters cost nothing.
class CalibrationPart {
 public:
  CalibrationPart(const Rig& rig, const RigCovariance& covariance);

  bool empty() const { return rank_ == 0 && !given_; }

  /// (3, 3) mm^2; NaN if a camera does not see the point.
  Eigen::Matrix3d Of(std::span<const Sighting> sightings, const Intersection& point) const;

 private:
  const Rig& rig_;
  bool given_ = false;
  bool moves_frame_ = false;
  int rank_ = 0;                             ///< columns of L
  int stride_ = 0;                           ///< the next multiple of eight
  std::vector<std::vector<int>> uncertain_;  ///< a camera: its rows of L that are not zero
  std::vector<double> factor_;               ///< row-major (16 K + 6, stride): L, then -M L
};

}  // namespace videogrammetry
