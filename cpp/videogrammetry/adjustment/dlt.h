#pragma once

#include <Eigen/Core>

#include "videogrammetry/geometry/rigid3.h"

namespace videogrammetry {

using Points3d = Eigen::Matrix<double, Eigen::Dynamic, 3>;
using Points2d = Eigen::Matrix<double, Eigen::Dynamic, 2>;

/// A distortion-free camera with its orientation, as the DLT finds it.
struct DltResult {
  /// Pixel = K * (X/Z, Y/Z, 1): upper triangular, K(2, 2) = 1, K(0, 0) and K(1, 1) > 0.
  Eigen::Matrix3d calibration;
  Rigid3 cam_from_object;
  double rms_px = 0.0;  ///< per coordinate
};

/// Shares of the extent along an object's principal axes: singular values of
/// the centred points over the largest, descending (1, s2, s3). s3 = 0 for a plane.
Eigen::Vector3d PrincipalExtents(const Eigen::Ref<const Points3d>& points_mm,
                                 Eigen::Matrix3d* axes = nullptr);

/// Direct linear transformation: the 11 parameters of the projective camera
/// from >= 6 non-coplanar points (Abdel-Aziz & Karara 1971), normalised as in
/// Hartley & Zisserman, Alg. 7.1 (without the non-linear step), and taken apart
/// into K, R, t by an RQ decomposition (their Sec. 6.2.4).
///
/// @throws std::invalid_argument for fewer than 6 points or unequal counts.
/// @throws AdjustmentError if the points are coplanar (or nearly: the linear
///     system has a second solution), or if the solution is mirrored or puts
///     points behind the camera.
DltResult DirectLinearTransform(const Eigen::Ref<const Points3d>& points_mm,
                                const Eigen::Ref<const Points2d>& pixels);

}  // namespace videogrammetry
