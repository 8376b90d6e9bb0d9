#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "videogrammetry/recognition/camera_model.h"
#include "videogrammetry/recognition/dot_fit.h"
#include "videogrammetry/recognition/dot_look.h"
#include "videogrammetry/recognition/edge_pair_search.h"
#include "videogrammetry/recognition/options.h"
#include "videogrammetry/recognition/target_edge.h"

namespace videogrammetry {

/// The areas of a picture that may be dots, from two searches of edge_pair_search.h.
///
/// A chord ends at the nearest edge beyond the threshold, so texture, compression or a
/// gleam inside a dot of high contrast breaks its chords where the threshold follows
/// faint edges. A second search at three times the threshold does not see them.
///
/// @param gradient_threshold  of the first search.
/// @return in the rows' order.
std::vector<DotRegion> FindDotAreas(const FrameView& frame, const RecognitionOptions& options,
                                    int gradient_threshold);

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
/// 3. The blurred ellipse (DotFitter). Where no more than 3 % of the contrast is left in
///    the residuals beyond noise, it is a dot. Where there is more, and where the fit
///    fails, something lies in front of the dot or near it, shines on it, or it is none:
///    MeasureTargetEdge of the local Canny decides, which sees what is none in some
///    microseconds, and FitModel measures.
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
    DotStart cut_out;  ///< as the area has it, its moments not yet those of grey values
    int region = 0;
  };

  std::optional<Start> BeginAt(const DotRegion& region, double blur_px);
  GreyWindow WindowOf(const EllipseFrame& frame, double more_px);
  std::optional<PictureModel> Learn(const std::vector<Start>& starts);
  std::optional<TargetEdge> MeasureByModel(const Start& start);
  std::optional<TargetEdge> MeasureByLocalCanny(const DotStart& dot);
  std::optional<TargetEdge> MeasureUnclearAt(const Start& start);
  double blur_px() const { return picture_ ? picture_->blur_px : DotFitter::kUsualBlurPx; }
  bool HasSize(const Ellipse& ellipse) const;

  const RecognitionOptions& options_;
  WindowReader reader_;
  DotFitter fitter_;
  std::optional<PictureModel> picture_;
  std::vector<Start> unclear_;
};

}  // namespace videogrammetry
