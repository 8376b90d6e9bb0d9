#pragma once

#include "videogrammetry/recognition/model_fit.h"

namespace videogrammetry {

/// What the pictures of one camera have in common while light and focus stay as
/// they are: learned from one of them, it spares the others the learning, and
/// every picture is measured by the same rule.
struct CameraModel {
  /// Of the search, see GradientThreshold; it grows with the noise (ThresholdByNoise) unless
  /// there is a second one.
  int gradient_threshold = 0;
  /// Of a second search for dots whose grey values vary so much that the first one's
  /// threshold sees edges inside them; 0: there were none.
  int second_threshold = 0;
  PictureModel picture;
};

}  // namespace videogrammetry
