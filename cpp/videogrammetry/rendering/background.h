#pragma once

#include <vector>

#include "videogrammetry/rendering/scene.h"

namespace videogrammetry {

/// Light over the picture as a function of the pixel.
class LightField {
 public:
  LightField(const Illumination& light, int width, int height)
      : by_x_(light.level * light.gradient[0] / width),
        by_y_(light.level * light.gradient[1] / height),
        at_origin_(light.level - 0.5 * (by_x_ * (width - 1) + by_y_ * (height - 1))) {}

  double At(double x_px, double y_px) const { return at_origin_ + by_x_ * x_px + by_y_ * y_px; }
  double by_x() const { return by_x_; }

 private:
  double by_x_, by_y_, at_origin_;
};

/// The background's light before the lens, row by row, without the specular
/// spots: level, and where `clutter` is not 0 cloudy noise (value noise of five
/// octaves), lines, rectangular patches and discs that cover each other.
std::vector<float> PaintBackground(const Background& background, const LightField& light, int width,
                                   int height);

/// Adds the glare of the spots, each blurred by the lens: sigma^2 + psf^2.
void AddSpots(const std::vector<SpecularSpot>& spots, double psf_sigma_px, int width, int height,
              std::vector<float>* picture);

}  // namespace videogrammetry
