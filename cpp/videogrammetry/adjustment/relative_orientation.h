#pragma once

#include <cstdint>
#include <vector>

#include "videogrammetry/adjustment/dlt.h"
#include "videogrammetry/geometry/camera.h"

namespace videogrammetry {

struct RelativeOrientationOptions {
  /// A pair further from its epipolar lines counts as a wrong number, px.
  double threshold_px = 2.0;
  /// Random fives at most; 600 find a good one among 55 % wrong numbers with 1 - 1e-5.
  int max_samples = 600;
  std::uint32_t seed = 1;
  /// Least parallax, in standard deviations of the image points, that is a baseline.
  double min_parallax = 3.0;
};

/// A motion between two pictures; the baseline's length is 1.
struct RelativePose {
  Rigid3 b_from_a;
  /// Mean of min(e^2, threshold^2), e the distance from the epipolar lines, px.
  double cost_px2 = 0.0;
  std::vector<bool> inlier;
  int inliers = 0;
  double convergence_rad = 0.0;  ///< median angle between the inliers' rays
};

struct RelativeOrientation {
  /// The better first; a second one where it fits as well (a plane), none
  /// without a baseline or without six pairs that agree.
  std::vector<RelativePose> candidates;
  /// The rotation alone that fits best, and how far it leaves the points, over
  /// their noise: near 1 the cameras stood at one place.
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  double parallax = 0.0;
  bool has_baseline = false;
};

/// Relative orientation of two pictures with known interior orientation, robust
/// against wrong numbers.
///
/// Five points in a random sampler (MSAC: cost mean min(e^2, threshold^2)); the
/// best motions, and those of the plane that fits the points best, refined over
/// rotation and direction of the baseline (5 degrees of freedom) by least squares
/// of the distances
///   e = b'E a / sqrt(|(E a)_xy|^2 / f_b^2 + |(E'b)_xy|^2 / f_a^2),  E = [t]x R   (1)
/// (Sampson's: the first-order length of the least correction of both image
/// points, px), a, b = (X/Z, Y/Z, 1): distortion is taken off before. A pair whose
/// rays meet behind a camera is no inlier.
///
/// Points of one plane allow two motions (Longuet-Higgins 1986); both are returned
/// where both see all points in front and fit alike: further pictures decide.
///
/// Without a baseline every E = [t]x R fits: a rotation alone is fitted as well,
/// and a motion is returned only if the rotation leaves `min_parallax` times the
/// noise that E leaves (medians).
///
/// @throws std::invalid_argument if the counts differ.
RelativeOrientation OrientRelatively(const Camera& camera_a,
                                     const Eigen::Ref<const Points2d>& pixels_a,
                                     const Camera& camera_b,
                                     const Eigen::Ref<const Points2d>& pixels_b,
                                     const RelativeOrientationOptions& options);

}  // namespace videogrammetry
