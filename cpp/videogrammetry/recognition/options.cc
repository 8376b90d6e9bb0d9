#include "videogrammetry/recognition/options.h"

#include <stdexcept>

namespace videogrammetry {

void RecognitionOptions::Check() const {
  const auto [smallest, largest] = diameter_px;
  if (!(smallest >= 3.0) || !(largest > smallest) || !(largest <= 2000.0)) {
    throw std::invalid_argument("diameter_px: expected 3 <= smallest < largest <= 2000, got (" +
                                std::to_string(smallest) + ", " + std::to_string(largest) + ")");
  }
  if (method != kEdgePair && method != kLocalCanny) {
    throw std::invalid_argument("method: expected 'edge-pair' or 'local-canny', got '" + method +
                                "'");
  }
}

RecognitionOptions RecognitionOptions::Resolved() const {
  Check();
  RecognitionOptions resolved = *this;
  if (estimator == Estimator::kOfMethod) {
    resolved.estimator = method == kEdgePair ? Estimator::kModel : Estimator::kMeanGradient;
  }
  return resolved;
}

}  // namespace videogrammetry
