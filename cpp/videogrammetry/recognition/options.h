#pragma once

#include <array>
#include <string>

namespace videogrammetry {

/// Which way a code ring is read, as seen in the picture (y down).
enum class ReadingDirection { kClockwise, kCounterClockwise };

/// Grey values of a dot and of what surrounds it.
enum class Polarity { kWhiteOnBlack, kBlackOnWhite };

/// How a dot that was found is measured: by the mean gradient's profiles across
/// its edge (target_edge.h), by the tangents that its gradients give (dual_conic.h), or by
/// a model of its grey values (model_fit.h). kOfMethod: the model for kEdgePair, the mean
/// gradient for kLocalCanny.
enum class Estimator { kOfMethod, kMeanGradient, kDualConic, kModel };

inline constexpr const char* kEdgePair = "edge-pair";
inline constexpr const char* kLocalCanny = "local-canny";

/// What to look for and how. Field for field the Python class
/// videogrammetry.recognition.RecognitionOptions.
struct RecognitionOptions {
  /// Name of the code family: see code_family.h. "none": no ring is read.
  std::string codes = "schneider-14";
  ReadingDirection direction = ReadingDirection::kClockwise;
  Polarity polarity = Polarity::kWhiteOnBlack;
  /// Smallest minor and largest major axis of a dot, full lengths in pixels;
  /// 3 <= min < max <= 2000.
  std::array<double, 2> diameter_px = {5.0, 200.0};
  /// kEdgePair, the fast way, or kLocalCanny, the paper's.
  std::string method = kEdgePair;
  /// The mean gradient is the paper's; the model is nearer to what the noise permits.
  Estimator estimator = Estimator::kOfMethod;

  /// @throws std::invalid_argument naming the field, what was expected and what was given.
  void Check() const;

  /// Checked, with the estimator that kOfMethod stands for.
  RecognitionOptions Resolved() const;
};

}  // namespace videogrammetry
