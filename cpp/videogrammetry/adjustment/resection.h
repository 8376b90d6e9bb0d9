#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "videogrammetry/adjustment/dlt.h"
#include "videogrammetry/geometry/camera.h"

namespace videogrammetry {

/// A pose of one picture with how well it fits.
struct PoseCandidate {
  Rigid3 cam_from_object;
  /// Mean over the points of min(e^2, threshold^2), e = distance in px.
  double cost_px2 = 0.0;
  int inliers = 0;  ///< points within the threshold
};

struct ResectionOptions {
  /// A point further from its prediction counts as a wrong number, px.
  double threshold_px = 10.0;
  /// Random triples; 60 find a good one among 30 % wrong numbers with 1 - 1e-10.
  int num_samples = 60;
  std::uint32_t seed = 1;
};

/// The ideal image points f (X/Z, Y/Z), from the principal point, of pixels
/// (see Undistort); infinite where the distortion cannot be inverted.
Points2d IdealPoints(const Camera& camera, const Eigen::Ref<const Points2d>& pixels);

/// Minimises the summed Cauchy loss of the ideal image points' distances over
/// the pose: Gauss-Newton with Levenberg's damping.
/// @param ideal_px  (N, 2) f (X/Z, Y/Z) as measured (see Undistort).
/// @param scale_px  scale of the loss.
/// @return false if fewer than 3 points lie in front of the camera.
bool RefinePose(const Eigen::Ref<const Points3d>& points_mm,
                const Eigen::Ref<const Points2d>& ideal_px, double f_px, double scale_px,
                Rigid3* cam_from_object);

/// Space resection of one picture with known interior orientation, robust
/// against wrong numbers: RANSAC on three points, the best poses and their
/// flipped ones refined on all points.
///
/// @return up to two poses that differ by more than 2 degrees, the better
///     first: of a flat target in a narrow field both may fit (see FlippedPose).
///     Empty if fewer than 4 points or no pose has 4 inliers.
std::vector<PoseCandidate> Resect(const Camera& camera, const Eigen::Ref<const Points3d>& points_mm,
                                  const Eigen::Ref<const Points2d>& pixels,
                                  const ResectionOptions& options);

}  // namespace videogrammetry
