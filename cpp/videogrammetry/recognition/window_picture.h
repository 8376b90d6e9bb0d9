#pragma once

// Private to the room.

#include <cstdint>
#include <vector>

#include "videogrammetry/recognition/grey_window.h"
#include "videogrammetry/recognition/model_fit.h"
#include "videogrammetry/recognition/signed_image.h"
#include "videogrammetry/recognition/target_edge.h"

namespace videogrammetry {

/// What the local Canny and FitModel may look at beyond an ellipse, pixels.
constexpr double kMostReachPx = 10.0;

/// A window's samples as a picture of its own, so that every depth's are the same.
class WindowPicture {
 public:
  WindowPicture(const GreyWindow& window, int sign)
      : x0_(window.x0),
        y0_(window.y0),
        samples_(Samples(window, sign)),
        image_(ImageView16(samples_.data(), window.width, window.height), sign) {}
  WindowPicture(const WindowPicture&) = delete;
  WindowPicture& operator=(const WindowPicture&) = delete;

  const SignedImage<std::uint16_t>& image() const { return image_; }
  Ellipse Inwards(Ellipse e) const { return Moved(e, -1); }
  Ellipse Outwards(Ellipse e) const { return Moved(e, 1); }

  /// Measures an edge anew by FitModel; if that fails or leaves it, it stays.
  /// @return whether it was measured.
  bool Refine(const PictureModel* picture, TargetEdge* edge) const;

 private:
  static std::vector<std::uint16_t> Samples(const GreyWindow& window, int sign);
  Ellipse Moved(Ellipse e, int direction) const {
    e.x_px += direction * x0_;
    e.y_px += direction * y0_;
    return e;
  }

  int x0_, y0_;
  std::vector<std::uint16_t> samples_;
  SignedImage<std::uint16_t> image_;
};

}  // namespace videogrammetry
