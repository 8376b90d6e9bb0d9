#include "videogrammetry/rendering/render.h"

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "videogrammetry/rendering/painting.h"
#include "videogrammetry/rendering/sensor.h"

namespace videogrammetry {
namespace {

constexpr int kMaxSide = 1 << 15;

const OrientedCamera& Checked(const OrientedCamera& camera) {
  const Camera& c = camera.camera;
  if (c.width_px < 1 || c.height_px < 1 || c.width_px > kMaxSide || c.height_px > kMaxSide) {
    throw std::invalid_argument("image_size_px: expected 1 ... 32768, got " +
                                std::to_string(c.width_px) + " x " + std::to_string(c.height_px));
  }
  if (!(c.f_px() > 0) || !c.interior.allFinite()) {
    throw std::invalid_argument("interior: expected finite numbers and f > 0, f is " +
                                std::to_string(c.f_px()));
  }
  const Rigid3& pose = camera.cam_from_world;
  const double off =
      (pose.rotation * pose.rotation.transpose() - Eigen::Matrix3d::Identity()).norm();
  if (!(off < 1e-6) || !pose.translation_mm.allFinite()) {
    throw std::invalid_argument(
        "cam_from_world: expected a rotation and a finite translation, R R' - I has the norm " +
        std::to_string(off));
  }
  return camera;
}

template <typename Options>
const Options& Checked(const Options& options) {
  options.Check();
  return options;
}

}  // namespace

Renderer::Renderer(const OrientedCamera& camera, const Background& background,
                   const Illumination& illumination, const Sensor& sensor)
    : camera_(Checked(camera)),
      sensor_(Checked(sensor)),
      light_(Checked(illumination), width(), height()),
      psf_(sensor.psf_sigma_px),
      raw_(PaintBackground(Checked(background), light_, width(), height())),
      blurred_(raw_) {
  if (background.clutter > 0) BlurPixels(sensor.psf_sigma_px, width(), height(), &blurred_);
  AddSpots(background.spots, sensor.psf_sigma_px, width(), height(), &blurred_);
}

std::vector<float> Renderer::Light(const std::vector<SceneTarget>& targets) const {
  std::vector<double> depth;
  for (const SceneTarget& target : targets) {
    target.Check();
    depth.push_back((camera_.cam_from_world * PoseAt(target, 0.5).center_mm).z());
  }
  std::vector<std::size_t> order(targets.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return depth[a] > depth[b]; });
  std::vector<FineWindow> far_to_near;
  far_to_near.reserve(targets.size());
  for (const std::size_t i : order) {
    far_to_near.push_back(PaintTarget(camera_, targets[i], light_, psf_));
  }
  std::vector<float> picture = blurred_;
  Compose(far_to_near, raw_, psf_, width(), height(), picture.data());
  return picture;
}

template <typename T>
void Renderer::Render(const std::vector<SceneTarget>& targets, std::uint64_t seed,
                      T* samples) const {
  if ((sensor_.bit_depth == 8) != std::is_same_v<T, std::uint8_t>) {
    throw std::invalid_argument(
        "samples: expected 8-bit samples for bit_depth 8 and 16-bit ones "
        "beyond, bit_depth is " +
        std::to_string(sensor_.bit_depth));
  }
  const std::vector<float> light = Light(targets);
  ReadOut(light.data(), light.size(), sensor_, seed, samples);
}

template void Renderer::Render(const std::vector<SceneTarget>&, std::uint64_t, std::uint8_t*) const;
template void Renderer::Render(const std::vector<SceneTarget>&, std::uint64_t,
                               std::uint16_t*) const;

}  // namespace videogrammetry
