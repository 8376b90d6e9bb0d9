#pragma once

#include <cstdint>
#include <vector>

#include "videogrammetry/geometry/rig.h"
#include "videogrammetry/rendering/background.h"
#include "videogrammetry/rendering/fine_window.h"
#include "videogrammetry/rendering/scene.h"
#include "videogrammetry/rendering/truth.h"

namespace videogrammetry {

/// One camera before one background under one light: renders pictures of targets.
///
/// The background is painted and blurred once; a picture costs its targets'
/// surroundings and one pass over its pixels. A Renderer does not change, so
/// several threads may use one.
class Renderer {
 public:
  /// @throws std::invalid_argument naming what is wrong with camera or options.
  Renderer(const OrientedCamera& camera, const Background& background,
           const Illumination& illumination, const Sensor& sensor);

  int width() const { return camera_.camera.width_px; }
  int height() const { return camera_.camera.height_px; }
  const Sensor& sensor() const { return sensor_; }
  const OrientedCamera& camera() const { return camera_; }

  /// Light of every pixel, before noise and sampling, as a share of full scale.
  /// Targets that no ray can meet (behind the camera, facing away) are left out.
  /// @throws std::invalid_argument if a target is not valid or moves too far.
  std::vector<float> Light(const std::vector<SceneTarget>& targets) const;

  /// The picture, height() rows of width() samples.
  /// @param seed  of the noise: one for each picture.
  /// @throws std::invalid_argument as Light, or if T does not fit the bit depth:
  ///     std::uint8_t for 8, std::uint16_t beyond.
  template <typename T>
  void Render(const std::vector<SceneTarget>& targets, std::uint64_t seed, T* samples) const;

  std::vector<TargetTruth> Truth(const std::vector<SceneTarget>& targets) const {
    return TruthOf(camera_, targets);
  }

 private:
  OrientedCamera camera_;
  Sensor sensor_;
  LightField light_;
  PsfKernel psf_;
  std::vector<float> raw_;      // background before the lens
  std::vector<float> blurred_;  // behind it, with the spots
};

}  // namespace videogrammetry
