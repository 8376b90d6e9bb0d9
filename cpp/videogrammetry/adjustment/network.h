#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "videogrammetry/geometry/camera.h"
#include "videogrammetry/geometry/circle.h"
#include "videogrammetry/geometry/rigid3.h"

namespace videogrammetry {

using InteriorVector = Eigen::Matrix<double, kNumInterior, 1>;

/// A camera of the network: ten interior parameters, each estimated or held.
struct NetworkCamera {
  std::string name;
  Camera camera;
  std::array<bool, kNumInterior> free{};
  /// Standard deviations with which the start values are observed; 0 = not observed.
  InteriorVector prior_sigma = InteriorVector::Zero();
  /// The observed values, and what a parameter is set to when it is not estimated.
  InteriorVector start = InteriorVector::Zero();
  /// Adds to every image coordinate's standard deviation (as variances add), px.
  double floor_px = 0.0;
  /// Multiplies the stated covariances; below 1 where the residuals show that
  /// they are too large.
  double cov_scale = 1.0;
};

/// A rigid motion that is estimated (`free`) or held. The six unknowns are a
/// rotation vector w and a shift d: R <- exp([w]) R, t <- t + d.
struct NetworkPose {
  std::string name;
  Rigid3 transform;
  bool free = true;
};

/// A picture: cam_from_object = poses[outer] * poses[inner].
///
/// A rig has one outer pose a camera (cam_from_rig) and one inner pose a stage
/// (rig_from_target); a picture with a pose of its own has outer = -1.
struct NetworkImage {
  std::string name;
  int camera = 0;
  int outer = -1;
  int inner = 0;
};

enum class PointKind { kFixed, kWeighted, kFree };

/// An object point; kWeighted points are observed with `prior_cov_mm2`.
///
/// Where `radius_mm` > 0 the point is the centre of a circle with the unit
/// `normal`, both held, and what a picture measures is its ellipse's centre.
struct NetworkPoint {
  int id = -1;
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  PointKind kind = PointKind::kFixed;
  Eigen::Vector3d prior_mm = Eigen::Vector3d::Zero();
  Eigen::Matrix3d prior_cov_mm2 = Eigen::Matrix3d::Identity();
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double radius_mm = 0.0;

  Circle mark() const { return {position_mm, normal, radius_mm}; }
};

/// An image point of known identity, with the covariance of its measurement.
struct NetworkObservation {
  int image = 0;
  int point = 0;
  Eigen::Vector2d xy_px = Eigen::Vector2d::Zero();
  Eigen::Matrix2d cov_px2 = Eigen::Matrix2d::Identity();
  bool used = true;
};

/// A photogrammetric network: what is observed and what is unknown.
///
/// The functional model is the collinearity equation with the ten interior
/// parameters of `Camera` (Hu et al. 2012, Eqs. 1-5): measured image point =
/// Project(camera, cam_from_object * point) + residual, of a circle
/// ProjectEllipseCenter instead of Project, evaluated anew in every iteration.
struct Network {
  std::vector<NetworkCamera> cameras;
  std::vector<NetworkPose> poses;
  std::vector<NetworkImage> images;
  std::vector<NetworkPoint> points;
  std::vector<NetworkObservation> observations;

  int camera_of(const NetworkObservation& o) const { return images[o.image].camera; }
  /// Covariance of an observation: its camera's scale times the stated one, plus the floor.
  Eigen::Matrix2d TotalCov(const NetworkObservation& o) const;
  Rigid3 CamFromObject(const NetworkImage& image) const;
  /// @throws std::invalid_argument that names the first index out of range,
  ///     number that is not finite or covariance that is not positive definite.
  void Check() const;
};

/// Units in which the interior parameters are of comparable effect: 1 px for
/// f, x0, y0; r0^-2, r0^-4, r0^-6 for A1, A2, A3; r0^-1 for B1, B2; 1 for E1, E2.
/// Without them A3 (1e-20) beside f (1e3) would ruin the normal equations.
InteriorVector InteriorScale(const Camera& camera);

/// Where each unknown stands: first the cameras' and poses' (the reduced
/// vector), then three a point. -1 = held.
struct UnknownIndex {
  explicit UnknownIndex(const Network& network);
  std::vector<std::array<int, kNumInterior>> interior;
  std::vector<int> pose;
  std::vector<int> point;  ///< Counted from 0 behind the reduced vector, in points.
  int num_reduced = 0;
  int num_points = 0;
  int num_unknowns() const { return num_reduced + 3 * num_points; }
};

/// "left A1", "stage 3 rx": the name of an unknown of the reduced vector.
std::string UnknownName(const Network& network, const UnknownIndex& index, int unknown);

}  // namespace videogrammetry
