#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "videogrammetry/geometry/camera.h"
#include "videogrammetry/geometry/circle.h"
#include "videogrammetry/geometry/refraction.h"
#include "videogrammetry/geometry/rigid3.h"

namespace videogrammetry {

/// A camera's unknowns: the ten of InteriorIndex, then these two.
///   kAspect: pixel height over pixel width, less 1;
///   kTimeOffset: moment of exposure, as a part of the interval between pictures.
/// See Sampling in observation_model.h.
enum CameraUnknown { kAspect = kNumInterior, kTimeOffset, kNumCameraUnknowns };

using InteriorVector = Eigen::Matrix<double, kNumInterior, 1>;
using CameraVector = Eigen::Matrix<double, kNumCameraUnknowns, 1>;
using CameraMask = std::array<bool, kNumCameraUnknowns>;

/// "f", ..., "E2", "aspect", "time_offset".
const char* CameraUnknownName(int unknown);

/// A camera of the network: twelve parameters, each estimated or held.
struct NetworkCamera {
  std::string name;
  Camera camera;
  CameraMask free{};
  /// Standard deviations with which the start values are observed; 0 = not observed.
  CameraVector prior_sigma = CameraVector::Zero();
  /// The observed values, and what a parameter is set to when it is not estimated.
  CameraVector start = CameraVector::Zero();
  /// Adds to every image coordinate's standard deviation (as variances add), px.
  double floor_px = 0.0;
  /// Multiplies the stated covariances; below 1 where the residuals show that
  /// they are too large.
  double cov_scale = 1.0;
  double aspect = 0.0;
  double time_offset = 0.0;
  /// Index of the window through which the camera looks; -1 = none.
  int interface = -1;
  /// True: residuals and covariances are those of the corrected image points
  /// (PredictObservation); of cameras of the measured direction alone.
  bool corrected_residual = false;

  CameraVector values() const;
  void set_values(const CameraVector& values);
};

/// A window's unknowns.
enum InterfaceUnknown { kTilt1 = 0, kTilt2, kDistance, kNumInterfaceUnknowns };

/// A window: three unknowns, each estimated or held, in the frame of the rig
/// (that the outer poses lead from; for images without one, of the object).
///
/// The normal is n ~ n0 + tilt_1 t1 + tilt_2 t2 with n0 the normal of `nominal`
/// and t1, t2 tangents (Tangents): the tilts are tangents of angles. The
/// distance is that of the plane from the frame's origin. Indices and glass are
/// those of `nominal`.
struct NetworkInterface {
  std::string name;
  FlatInterface nominal;
  std::array<bool, kNumInterfaceUnknowns> free{};
  /// Standard deviations with which the start values (0, 0, the nominal
  /// distance) are observed; 0 = not observed.
  Eigen::Vector3d prior_sigma = Eigen::Vector3d::Zero();
  Eigen::Vector2d tilt = Eigen::Vector2d::Zero();
  double distance_mm = 0.0;

  Eigen::Vector3d values() const { return {tilt[0], tilt[1], distance_mm}; }
  Eigen::Vector3d start() const { return {0.0, 0.0, nominal.distance_mm}; }
  void set_values(const Eigen::Vector3d& values) {
    tilt = values.head<2>();
    distance_mm = values[kDistance];
  }
  /// t1: the frame's axis that is most across n0, projected; t2 = n0 x t1.
  Eigen::Matrix<double, 3, 2> Tangents() const;
  /// The window at the present values; `normal_by_tilt` gets dn/d(tilts).
  FlatInterface surface(Eigen::Matrix<double, 3, 2>* normal_by_tilt = nullptr) const;
};

/// "tilt_1", "tilt_2", "distance".
const char* InterfaceUnknownName(int unknown);

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

/// An object point; kWeighted points are observed with `prior_cov_mm2`, those
/// of the network's prior block with that block's covariance instead.
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
  /// False: the point's a-priori position is set aside as an outlier.
  bool prior_used = true;
  /// True: nothing determines the point; it is no unknown and not observed.
  bool starved = false;

  bool is_unknown() const { return kind != PointKind::kFixed && !starved; }
  bool is_observed() const { return kind == PointKind::kWeighted && prior_used && !starved; }
  Circle mark() const { return {position_mm, normal, radius_mm}; }
};

/// An image point of known identity, with the covariance of its measurement.
struct NetworkObservation {
  int image = 0;
  int point = 0;
  Eigen::Vector2d xy_px = Eigen::Vector2d::Zero();
  Eigen::Matrix2d cov_px2 = Eigen::Matrix2d::Identity();
  bool used = true;
  /// Motion of the image point in one interval between pictures, for kTimeOffset.
  Eigen::Vector2d velocity_px = Eigen::Vector2d::Zero();
};

/// A known distance between two points (indices): length_mm = |X_a - X_b| + residual.
struct NetworkScaleBar {
  int a = 0;
  int b = 0;
  double length_mm = 0.0;
  double sigma_mm = 1.0;
  bool used = true;
};

/// Some weighted points observed together, with their full covariance.
struct PriorBlock {
  std::vector<int> points;
  Eigen::VectorXd mean_mm;  ///< (3K)
  Eigen::MatrixXd cov_mm2;  ///< (3K, 3K), regular
  /// (K) whether a point's prior takes part when `weight_per_mm2` was made.
  std::vector<bool> in_weight;
  /// Inverse of the covariance of those that take part, zero for the others.
  Eigen::MatrixXd weight_per_mm2;
  /// W with W' W = weight_per_mm2.
  Eigen::MatrixXd whiten_per_mm;

  bool contains(int point) const;
  /// Makes the weights anew if other points take part than before.
  void Update(const std::vector<NetworkPoint>& all);
};

/// What the object's frame rests on.
///   kWeighted, kFixed: weighted or fixed points or held poses;
///   kFree: inner constraints over all points (free network): shift, rotation
///   and, where nothing gives the scale, scale of the points against their start values.
enum class Datum { kFixed, kWeighted, kFree };

/// A photogrammetric network: what is observed and what is unknown.
///
/// The functional model is the collinearity equation with the ten interior
/// parameters of `Camera` (Hu et al. 2012, Eqs. 1-5): measured image point =
/// Project(camera, cam_from_object * point) + residual, of a circle
/// ProjectEllipseCenter instead of Project, evaluated anew in every iteration;
/// aspect and time offset as in Sampling (observation_model.h). Through a window
/// it is the point of its surface that the ray meets (SeenThrough).
struct Network {
  std::vector<NetworkCamera> cameras;
  std::vector<NetworkPose> poses;
  std::vector<NetworkInterface> interfaces;
  std::vector<NetworkImage> images;
  std::vector<NetworkPoint> points;
  std::vector<NetworkObservation> observations;
  std::vector<NetworkScaleBar> scale_bars;
  PriorBlock prior_block;
  Datum datum = Datum::kWeighted;

  /// Sets the prior block, of weighted points. A covariance that is singular
  /// because it came from a free network gets a variance along the datum's directions
  /// (shift, rotation, then scale) of the size of its average variance: what
  /// can be estimated does not change by it, for poses absorb such motions.
  /// @throws std::invalid_argument if sizes differ, a point is not weighted or
  ///     named twice, or the covariance stays singular.
  void SetPriorBlock(const std::vector<int>& points, const Eigen::VectorXd& mean_mm,
                     const Eigen::MatrixXd& cov_mm2);

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

/// The same for a camera's twelve unknowns; 1 for the aspect and the time offset.
CameraVector CameraScale(const Camera& camera);

/// Where each unknown stands: the cameras', the poses', the windows', then three a point.
/// -1 = held.
struct UnknownIndex {
  explicit UnknownIndex(const Network& network);
  std::vector<std::array<int, kNumCameraUnknowns>> camera;
  std::vector<int> pose;  ///< first of six
  std::vector<std::array<int, kNumInterfaceUnknowns>> interface;
  std::vector<int> point;   ///< first of three
  int num_orientation = 0;  ///< the cameras', poses' and windows', which come first
  int num_unknowns = 0;
};

/// Adds a step to the unknowns; a pose turns by its rotation vector.
void MoveUnknowns(const UnknownIndex& index, const Eigen::VectorXd& step, Network* network);

/// "left A1", "stage 3 rx", "point 7 x": the name of an unknown.
std::string UnknownName(const Network& network, const UnknownIndex& index, int unknown);
/// The names of all unknowns, in order.
std::vector<std::string> UnknownNames(const Network& network, const UnknownIndex& index);

}  // namespace videogrammetry
