#pragma once

#include "videogrammetry/recognition/model_fit.h"

namespace videogrammetry {

/// What the pictures of one camera have in common while light and focus stay as
/// they are: learned from one of them, it spares the others the learning, and
/// every picture is measured by the same rule.
struct CameraModel {
  int gradient_threshold = 0;  ///< of the search, see GradientThreshold; 0: of each picture
  PictureModel picture;
};

}  // namespace videogrammetry
