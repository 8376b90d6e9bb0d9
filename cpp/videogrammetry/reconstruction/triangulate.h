#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "videogrammetry/geometry/intersection.h"

namespace videogrammetry {

/// Matches as flat arrays: point i has the sightings [offsets[i], offsets[i+1]).
struct MatchArrays {
  std::span<const std::int64_t> offsets;  ///< P + 1, ascending, offsets[0] = 0
  std::span<const std::int32_t> camera;   ///< index into the rig
  const double* xy_px = nullptr;          ///< (M, 2); may stay null where pictures are not read
  const double* cov_px2 = nullptr;        ///< (M, 3): xx, xy, yy
};

/// Options of the reconstruction.
struct TriangulationOptions {
  int num_threads = 1;  ///< 0: one a core
};

/// Points with covariance; a failed point keeps NaN and its status.
struct TriangulatedPoints {
  std::vector<double> position_mm;      ///< (P, 3)
  std::vector<double> cov_image;        ///< (P, 3, 3) mm^2, from the image noise
  std::vector<double> cov_rig;          ///< (P, 3, 3) mm^2, from the calibration; 0 without one
  std::vector<double> chi2;             ///< (P), 2n - 3 degrees of freedom
  std::vector<double> convergence_rad;  ///< (P)
  std::vector<double> residual_px;      ///< (M, 2) measured - adjusted
  std::vector<std::uint8_t> status;     ///< (P) IntersectionStatus
};

/// What the calibration leaves uncertain, and in which frame that is stated.
///
/// A calibration determines the cameras relative to each other; where the
/// frame itself lies (say, on the axes of the first camera) is a definition.
/// Stated in that camera's axes, every point carries the uncertainty of its
/// principal point and direction, although it moves all points alike and harms
/// no distance, shape or motion. `Datum` takes out the rigid motion that an
/// error of the parameters shares over a set of points, the inner constraints
/// (S-transformation, Baarda 1973): sum over the points of A^T dX = 0,
/// A = [-[X]_x, I].
struct RigCovariance {
  /// (16 K, 16 K), camera by camera as kNumCameraParameters says; 0 rows: none.
  Eigen::MatrixXd parameters;
  /// (6, 16 K) rotation vector and translation of the frame by the parameters;
  /// 0 rows: the covariance stays in the rig's axes.
  Eigen::MatrixXd frame_by_parameters;
};

/// The rigid motion, by the cameras' parameters, that the points of `matches`
/// share: the `frame_by_parameters` of RigCovariance. Points that cannot be
/// intersected are left out.
/// @throws std::invalid_argument if fewer than three points remain.
Eigen::MatrixXd SharedFrameMotion(const Rig& rig, const MatchArrays& matches);

/// Triangulates many points with the cameras' orientation held.
///
/// Two covariances per point: cov_image = (J^T W J)^-1, and the calibration's
/// part G C G^T with G = -(J^T W J)^-1 J^T W A, A the derivatives of the
/// pictures by the cameras' parameters and C their covariance, in the frame
/// that RigCovariance says. Errors of the calibration are common to all points
/// of a rig; cov_rig is the part of one point alone.
///
/// @throws std::invalid_argument on inconsistent sizes or a camera index out of range.
TriangulatedPoints Triangulate(const Rig& rig, const MatchArrays& matches,
                               const RigCovariance& rig_covariance = {},
                               const TriangulationOptions& options = {});

/// Derivatives of given points by the parameters of all cameras: of every point
/// a row-major (3, 16 K) block G - A M, 0 in the columns of cameras that do not
/// see it (before the frame's motion M is taken out). Errors of the calibration
/// are common to all points and stages: cov_rig(i, j) = G_i C G_j^T.
///
/// @param matches  which cameras see a point, with which covariance; pictures are not read.
/// @param position_mm  (P, 3) where the points lie; NaN gives NaN.
/// @param frame_by_parameters  as in RigCovariance; 0 rows: in the rig's axes.
/// @return (P, 3, 16 K); NaN for a point with fewer than two sightings, behind a
///     camera, or with parallel rays.
/// @throws std::invalid_argument on inconsistent sizes or a camera index out of range.
std::vector<double> PointDerivatives(const Rig& rig, const MatchArrays& matches,
                                     std::span<const double> position_mm,
                                     const Eigen::MatrixXd& frame_by_parameters,
                                     const TriangulationOptions& options = {});

}  // namespace videogrammetry
