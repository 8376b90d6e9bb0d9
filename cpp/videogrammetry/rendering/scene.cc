#include "videogrammetry/rendering/scene.h"

#include <cmath>
#include <stdexcept>
#include <string>

#include "videogrammetry/geometry/rigid3.h"

namespace videogrammetry {
namespace {

/// Largest deviation of a length from 1 and of an angle from 90 degrees.
constexpr double kUnitTolerance = 1e-6;
constexpr int kMaxShapes = 10000;

void Require(bool good, const char* field, const std::string& expected, double got) {
  if (!good) {
    throw std::invalid_argument(std::string(field) + ": expected " + expected + ", got " +
                                std::to_string(got));
  }
}

void CheckShare(const char* field, double value) {
  Require(value >= 0 && value <= 1, field, "0 ... 1", value);
}

void CheckNotNegative(const char* field, double value) {
  Require(value >= 0 && std::isfinite(value), field, "a finite number >= 0", value);
}

void CheckPose(const TargetPose& pose, const std::string& prefix) {
  const auto name = [&](const char* field) { return prefix + field; };
  Require(pose.center_mm.allFinite(), name("center_mm").c_str(), "finite numbers",
          pose.center_mm.sum());
  Require(std::abs(pose.normal.norm() - 1) < kUnitTolerance, name("normal").c_str(),
          "a unit vector, its length", pose.normal.norm());
  Require(std::abs(pose.x_axis.norm() - 1) < kUnitTolerance, name("x_axis").c_str(),
          "a unit vector, its length", pose.x_axis.norm());
  Require(std::abs(pose.x_axis.dot(pose.normal)) < kUnitTolerance, name("x_axis").c_str(),
          "at right angles to normal, their product", pose.x_axis.dot(pose.normal));
}

Eigen::Matrix3d AxesOf(const TargetPose& pose) {
  Eigen::Matrix3d axes;
  axes << pose.x_axis, pose.normal.cross(pose.x_axis), pose.normal;
  return axes;
}

}  // namespace

void SceneTarget::Check() const {
  CheckPose(pose, "");
  if (end_pose) CheckPose(*end_pose, "end ");
  Require(radius_mm > 0 && std::isfinite(radius_mm), "radius_mm", "a finite number > 0", radius_mm);
  Require(num_bits == 0 || (num_bits >= 2 && num_bits <= 32), "num_bits", "0 or 2 ... 32",
          num_bits);
  if (num_bits > 0) {
    Require(num_bits == 32 || code < (std::uint32_t{1} << num_bits), "code",
            "a number that fits into num_bits", code);
    Require(ring[0] >= 1 && ring[1] > ring[0] && std::isfinite(ring[1]), "ring",
            "1 <= inner < outer, inner", ring[0]);
  }
  Require(sticker_mm >= marked_mm() * (1 - 1e-12) && std::isfinite(sticker_mm), "sticker_mm",
          "not less than the radius of what is printed, " + std::to_string(marked_mm()),
          sticker_mm);
  CheckShare("white", white);
  CheckShare("black", black);
  for (const double g : gradient) {
    // Light must not become negative on the sticker's far corner.
    const double change = std::abs(g) * sticker_mm / radius_mm;
    Require(change < 0.5, "gradient", "a change below 0.5 at the sticker's border", change);
  }
}

void Background::Check() const {
  CheckShare("level", level);
  CheckShare("clutter", clutter);
  Require(num_discs >= 0 && num_discs <= kMaxShapes, "num_discs", "0 ... 10000", num_discs);
  Require(num_lines >= 0 && num_lines <= kMaxShapes, "num_lines", "0 ... 10000", num_lines);
  Require(num_patches >= 0 && num_patches <= kMaxShapes, "num_patches", "0 ... 10000", num_patches);
  for (const SpecularSpot& spot : spots) {
    Require(std::isfinite(spot.x_px) && std::isfinite(spot.y_px), "spots", "a finite place",
            spot.x_px);
    Require(spot.sigma_px > 0 && std::isfinite(spot.sigma_px), "spots", "a finite sigma_px > 0",
            spot.sigma_px);
    CheckNotNegative("spots' amplitude", spot.amplitude);
  }
}

void Illumination::Check() const {
  Require(level > 0 && std::isfinite(level), "illumination level", "a finite number > 0", level);
  const double change = std::abs(gradient[0]) + std::abs(gradient[1]);
  Require(change < 2, "illumination gradient", "|gx| + |gy| < 2", change);
}

void Sensor::Check() const {
  Require(psf_sigma_px >= 0 && psf_sigma_px <= 10, "psf_sigma_px", "0 ... 10", psf_sigma_px);
  CheckNotNegative("read_noise", read_noise);
  CheckNotNegative("shot_noise_gain", shot_noise_gain);
  Require(
      bit_depth == 8 || bit_depth == 10 || bit_depth == 12 || bit_depth == 14 || bit_depth == 16,
      "bit_depth", "8, 10, 12, 14 or 16", bit_depth);
}

TargetPose PoseAt(const SceneTarget& target, double time) {
  if (!target.end_pose) return target.pose;
  const TargetPose &from = target.pose, &to = *target.end_pose;
  const Eigen::Vector3d turn = VectorFromRotation(AxesOf(to) * AxesOf(from).transpose());
  const Eigen::Matrix3d rotation = RotationFromVector(time * turn);
  return {(1 - time) * from.center_mm + time * to.center_mm, rotation * from.normal,
          rotation * from.x_axis};
}

}  // namespace videogrammetry
