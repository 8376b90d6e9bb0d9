#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "videogrammetry/geometry/circle_normal.h"
#include "videogrammetry/geometry/intersection.h"

namespace videogrammetry {

/// Matches as flat arrays: point i has the sightings [offsets[i], offsets[i+1]).
struct MatchArrays {
  std::span<const std::int64_t> offsets;  ///< P + 1, ascending, offsets[0] = 0
  std::span<const std::int32_t> camera;   ///< index into the rig
  const double* xy_px = nullptr;          ///< (M, 2); may stay null where pictures are not read
  const double* cov_px2 = nullptr;        ///< (M, 3): xx, xy, yy
};

/// Circles whose ellipses were measured, beside MatchArrays. Any pointer may be
/// null: nothing known.
struct CircleArrays {
  const double* diameter_mm = nullptr;  ///< (P); NaN: its ellipses' centres are not corrected
  const double* ellipse = nullptr;      ///< (M, 3): semi-major, semi-minor axis, angle
  const double* ellipse_cov = nullptr;  ///< (M, 9): their covariance (px, px, rad)
  const double* normal = nullptr;       ///< (P, 3) known unit normals; NaN: from the ellipses
  const double* normal_cov = nullptr;   ///< (P, 9) of the known normals; null: exact
  /// Height of the circle's plane over the object: points move by this much
  /// against the normal that faces the cameras.
  double thickness_mm = 0.0;

  bool empty() const { return diameter_mm == nullptr && thickness_mm == 0; }
};

/// What was done about a point's circle.
enum class CircleStatus {
  kNone,       ///< nothing was asked for: no diameter, no thickness
  kKnown,      ///< done, by a normal that was given
  kEstimated,  ///< done, by the normal of the ellipses
  kNoNormal    ///< not done: no normal, and no ellipse that says one; or seen through a window
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
  // Only where circles were given:
  std::vector<double> normal;        ///< (P, 3) unit, towards the cameras; NaN: none
  std::vector<double> cov_normal;    ///< (P, 3, 3)
  std::vector<double> offset_px;     ///< (M, 2) ellipse's centre - picture of the centre; 0: none
  std::vector<std::uint8_t> circle;  ///< (P) CircleStatus
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
/// Circles: with a diameter the residuals are those of the ellipses' centres
/// (ProjectEllipseCenter), so that positions are those of the circles' centres.
/// A normal that is uncertain is an observed unknown n0 + T d beside the point,
/// common to its cameras: with Q the inverse of both unknowns' normal equations
/// cov_image = Q_XX, which is what the correction adds and no more. With a
/// thickness t the point moves to X - t n0, and
///   cov_image = Q_XX - t (Q_Xd T^T + T Q_dX) + t^2 T C_n T^T.
///
/// @throws std::invalid_argument on inconsistent sizes, a camera index out of
///     range, a diameter that is not positive, a known normal that is not of
///     unit length or a thickness that is not finite.
TriangulatedPoints Triangulate(const Rig& rig, const MatchArrays& matches,
                               const RigCovariance& rig_covariance = {},
                               const TriangulationOptions& options = {},
                               const CircleArrays& circles = {});

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
