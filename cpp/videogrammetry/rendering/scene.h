#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

namespace videogrammetry {

/// Where a target lies: the plane's own axes are x_axis and
/// y_axis = x_axis x normal, so that x turns into y clockwise for an eye that
/// the normal points at.
struct TargetPose {
  Eigen::Vector3d center_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal = -Eigen::Vector3d::UnitZ();  ///< towards the viewer; unit
  Eigen::Vector3d x_axis = Eigen::Vector3d::UnitX();   ///< in the plane; unit

  Eigen::Vector3d y_axis() const { return x_axis.cross(normal); }
};

enum class StickerShape { kDisc, kSquare };

/// A printed target: a dot, a ring of code sectors if it has a code, on a sticker.
struct SceneTarget {
  TargetPose pose;  ///< at the beginning of the exposure
  /// At the end of the exposure; in between the centre moves straight and the
  /// axes turn evenly.
  std::optional<TargetPose> end_pose;
  double radius_mm = 5.0;  ///< of the dot, > 0
  int id = -1;             ///< for the truth alone
  /// Sectors of the ring, 0 (un-coded) or 2 ... 32; sector 0 begins at x_axis,
  /// and the most significant of num_bits bits is its brightness.
  int num_bits = 0;
  std::uint32_t code = 0;
  std::array<double, 2> ring = {2.0,
                                3.0};  ///< inner and outer radius over radius_mm, 1 <= in < out
  /// Radius of the sticker's disc or half a side of its square; not less than
  /// what is printed on it.
  double sticker_mm = 10.0;
  StickerShape sticker = StickerShape::kSquare;
  double white = 0.8;  ///< reflectances, 0 ... 1
  double black = 0.06;
  bool white_on_black = true;  ///< dot and sectors white, sticker black, or the reverse
  /// Relative change of the light over one radius along x_axis and y_axis.
  std::array<double, 2> gradient = {0.0, 0.0};

  /// Outermost radius of what is printed: the ring's, or the dot's.
  double marked_mm() const { return num_bits > 0 ? ring[1] * radius_mm : radius_mm; }
  /// @throws std::invalid_argument naming the field, what was expected and what was given.
  void Check() const;
};

/// A spot of glare in the picture: a Gaussian, added to what is behind it.
struct SpecularSpot {
  double x_px = 0.0;
  double y_px = 0.0;
  double sigma_px = 5.0;   ///< before the lens' blur; > 0
  double amplitude = 0.5;  ///< share of full scale at the top, >= 0
};

/// What lies behind the targets, in reflectance; the same for a seed everywhere.
struct Background {
  double level = 0.35;   ///< 0 ... 1
  double clutter = 0.0;  ///< amplitude of the clutter, 0 (none) ... 1
  int num_discs = 15;    ///< of the clutter, 0 ... 10000
  int num_lines = 20;    ///< 0 ... 10000
  int num_patches = 20;  ///< 0 ... 10000
  std::uint64_t seed = 0;
  std::vector<SpecularSpot> spots;

  void Check() const;  ///< @throws std::invalid_argument
};

/// Light over the picture: 1 + gradient . ((x, y) - centre) / (width, height).
struct Illumination {
  double level = 1.0;  ///< share of full scale that reflectance 1 gives; > 0
  std::array<double, 2> gradient = {0.0, 0.0};  ///< |gx| + |gy| < 2

  void Check() const;  ///< @throws std::invalid_argument
};

/// Lens blur, noise and samples. Noise in grey levels of the picture:
/// variance = read_noise^2 + shot_noise_gain * grey value.
struct Sensor {
  double psf_sigma_px = 0.7;     ///< 0 ... 10
  double read_noise = 0.0;       ///< grey levels, >= 0
  double shot_noise_gain = 0.0;  ///< grey levels^2 a grey level, >= 0
  int bit_depth = 8;             ///< 8, 10, 12, 14 or 16

  int full_scale() const { return (1 << bit_depth) - 1; }
  void Check() const;  ///< @throws std::invalid_argument
};

/// The pose at `time`, 0 the exposure's beginning, 1 its end.
TargetPose PoseAt(const SceneTarget& target, double time);

}  // namespace videogrammetry
