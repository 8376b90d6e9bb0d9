#pragma once

#include <optional>
#include <vector>

#include "videogrammetry/geometry/conic.h"
#include "videogrammetry/geometry/rig.h"
#include "videogrammetry/rendering/scene.h"

namespace videogrammetry {

/// Why a target can or cannot be measured in a picture. The first that holds.
enum class Visibility {
  kBehind = 0,  ///< it reaches behind the camera
  kFacingAway,  ///< the camera sees its back
  kOutside,     ///< nothing of what is printed lies in the picture
  kCut,         ///< the picture's border cuts what is printed
  kOccluded,    ///< another target hides a part of what is printed
  kVisible
};

/// What is true of one target in one picture, at the middle of the exposure.
struct TargetTruth {
  Visibility visibility = Visibility::kBehind;
  /// Picture of the circle's centre and ellipse of the circle's picture; none
  /// where the target reaches behind the camera, faces away or lies where the
  /// distortion folds over.
  std::optional<Eigen::Vector2d> circle_center_px;
  std::optional<Ellipse> ellipse;
  /// Largest distance of the circle's picture from that ellipse: distortion
  /// bends an ellipse into something that is none.
  double ellipse_error_px = 0.0;
};

/// The ellipse of a circle's picture, fitted to `kRimPoints` exactly projected
/// points of it by least squared distances along the normals; without distortion
/// the picture is a conic and the fit exact.
/// @return nullopt if a point has no picture.
std::optional<Ellipse> EllipseOfCircle(const OrientedCamera& camera, const TargetPose& pose,
                                       double radius_mm, double* error_px = nullptr);
inline constexpr int kRimPoints = 32;

/// Whether the camera sees the target's front, whole: before the camera, facing it.
enum class Facing { kBehind, kAway, kFront };
Facing FacingOf(const OrientedCamera& camera, const TargetPose& pose, double reach_mm);

/// Truth of all targets. A target is occluded where rays to its centre and to
/// points of the dot's and the ring's rim (32 each) meet a nearer target's
/// sticker: slivers between two such points go unnoticed.
std::vector<TargetTruth> TruthOf(const OrientedCamera& camera,
                                 const std::vector<SceneTarget>& targets);

}  // namespace videogrammetry
