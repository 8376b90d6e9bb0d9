#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "videogrammetry/recognition/camera_model.h"
#include "videogrammetry/recognition/dot_fit.h"
#include "videogrammetry/recognition/edge_pair_search.h"
#include "videogrammetry/recognition/options.h"
#include "videogrammetry/recognition/target_edge.h"

namespace videogrammetry {

/// A dot measured, and how much of its grey values the model leaves open.
struct DotMeasurement {
  TargetEdge edge;
  int region = 0;  ///< the area it was found as
};

/// Measures the areas of one picture that may be dots: those that are.
///
/// 1. A look at sixteen places: brighter inside than outside all around.
/// 2. Noise, blur and evenness of the light from some dots, if no camera's model is
///    given (PoolModels, PoolGradient).
/// 3. The blurred ellipse (DotFitter). What of the residuals is more than noise, in
///    units of the contrast, says what it is: a dot up to 3 %, no dot from 15 % on.
///    In between, and where the fit fails, something lies in front of the dot,
///    shines on it, or it is none: MeasureTargetEdge of the local Canny decides, and
///    FitModel measures.
class EdgePairRecognition {
 public:
  EdgePairRecognition(const FrameView& frame, const RecognitionOptions& options);

  /// Measures what is clearly a dot, in the areas' order; what is unclear is kept.
  ///
  /// @param camera  nullptr: learned from the picture.
  std::vector<DotMeasurement> MeasureClear(const std::vector<DotRegion>& regions,
                                           const CameraModel* camera);

  /// Measures what MeasureClear left, but for what lies where `leave_out` says true.
  std::vector<DotMeasurement> MeasureUnclear(const std::function<bool(const Ellipse&)>& leave_out);

  /// The picture's model after MeasureClear; nullopt if it had no dots.
  const std::optional<PictureModel>& picture() const { return picture_; }

 private:
  struct Start {
    DotStart dot;
    int region = 0;
  };

  std::optional<Start> BeginAt(const DotRegion& region, double blur_px);
  GreyWindow WindowOf(const EllipseFrame& frame, double more_px);
  std::optional<PictureModel> Learn(const std::vector<Start>& starts);
  std::optional<TargetEdge> MeasureByModel(const Start& start);
  std::optional<TargetEdge> MeasureByLocalCanny(const Start& start);
  bool HasSize(const Ellipse& ellipse) const;

  const RecognitionOptions& options_;
  WindowReader reader_;
  DotFitter fitter_;
  std::optional<PictureModel> picture_;
  std::vector<Start> unclear_;
};

}  // namespace videogrammetry
