#pragma once

#include "videogrammetry/recognition/ring_code.h"
#include "videogrammetry/recognition/target_edge.h"

namespace videogrammetry {

/// A target found in a picture.
struct Target {
  TargetEdge edge;
  RingReading ring;
};

}  // namespace videogrammetry
