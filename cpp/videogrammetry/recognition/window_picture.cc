#include "videogrammetry/recognition/window_picture.h"

namespace videogrammetry {

bool WindowPicture::Refine(const PictureModel* picture, TargetEdge* edge) const {
  TargetEdge local = *edge;
  local.ellipse = Inwards(edge->ellipse);
  const auto fit = FitModel(image_, local, picture);
  if (!fit || HasLeft(local.ellipse, fit->ellipse)) return false;
  edge->ellipse = Outwards(fit->ellipse);
  edge->cov = fit->cov;
  edge->inside = fit->inside;
  edge->outside = fit->outside;
  return true;
}

std::vector<std::uint16_t> WindowPicture::Samples(const GreyWindow& window, int sign) {
  std::vector<std::uint16_t> samples;
  samples.reserve(static_cast<std::size_t>(window.width) * static_cast<std::size_t>(window.height));
  for (int y = window.y0; y < window.y0 + window.height; ++y) {
    for (int x = window.x0; x < window.x0 + window.width; ++x) {
      samples.push_back(static_cast<std::uint16_t>(static_cast<float>(sign) * window(x, y)));
    }
  }
  return samples;
}

}  // namespace videogrammetry
