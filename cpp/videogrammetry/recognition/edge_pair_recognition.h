#pragma once

#include <array>
#include <cmath>
#include <optional>
#include <vector>

#include "videogrammetry/recognition/camera_model.h"
#include "videogrammetry/recognition/code_family.h"
#include "videogrammetry/recognition/dot_fit.h"
#include "videogrammetry/recognition/edge_pair_search.h"
#include "videogrammetry/recognition/grey_sampler.h"
#include "videogrammetry/recognition/options.h"
#include "videogrammetry/recognition/place_index.h"
#include "videogrammetry/recognition/ring_code.h"
#include "videogrammetry/recognition/target.h"
#include "videogrammetry/recognition/target_selection.h"

namespace videogrammetry {

/// A dot as the picture before lets it be expected.
struct ExpectedDot {
  TargetEdge edge;   ///< as it was measured, its centre where it is expected
  RingReading ring;  ///< as it was read

  /// Whether it may be the same dot: axes change by a quarter at most.
  bool IsLike(const Ellipse& other) const;
};

/// What breaks the chords of dots at the search's threshold: nothing, noise that grows with
/// the grey value, or texture.
enum class DotInside { kEven, kNoisy, kTextured };

struct InsideOfDots {
  DotInside kind = DotInside::kEven;
  double step = 0.0;  ///< four deviations of a difference of grey values inside
};

/// Makes targets of the areas of one picture that may be dots.
///
/// The areas are taken from the largest to the smallest, so that a ring has been read
/// before its sectors come: those are passed over. Of each:
///
/// 1. A look around: brighter inside than outside on all sides, and how bright.
/// 2. The second moments of the grey values, and the blurred ellipse (DotFitter). Where no
///    more than 3 % of the contrast is left in the residuals beyond noise, it is a dot.
///    Where there is more, where the fit fails, and where the noise is such that residuals
///    tell nothing, something lies in front of the dot or near it, shines on it, or it is
///    none: MeasureTargetEdge of the local Canny decides, which sees what is none in some
///    microseconds, and FitModel measures.
/// 3. The ring.
///
/// Noise, blur and evenness of the light are learned from some dots (PoolModels,
/// PoolGradient, MeasureFlare) if no camera's model is given. In a picture with light that is
/// added, not multiplied, FitModel measures clear dots too.
class EdgePairRecognition {
 public:
  EdgePairRecognition(const FrameView& frame, const RecognitionOptions& options,
                      const CodeFamily& family, int gradient_threshold);

  /// Learns noise, blur and light from some of the areas; to be called first, this or
  /// SetPicture.
  void Learn(const std::vector<DotRegion>& regions);
  void SetPicture(const PictureModel& picture) { picture_ = picture; }

  /// The picture's model; nullopt if it had no dots.
  const std::optional<PictureModel>& picture() const { return picture_; }
  /// What the dots that were learned from look like inside.
  DotInside inside() const { return inside_.kind; }
  /// Four deviations of a difference of their grey values inside.
  int inside_threshold() const { return static_cast<int>(std::ceil(inside_.step)); }

  /// Measures dots where they are expected, without a search, by the same look, start and
  /// fit; SetPicture comes before, Measure after it for all others.
  ///
  /// @return numbers of those that were not found or are no clear dots.
  std::vector<int> MeasureExpected(const std::vector<ExpectedDot>& dots);

  /// Where targets are that have been measured, with their rings: nothing else is there.
  KnownParts MeasuredParts() const;

  /// @return the targets in the order of their centres' y, then x.
  std::vector<Target> Measure(const std::vector<DotRegion>& regions);

 private:
  struct Start {
    DotStart dot;
    DotStart cut_out;  ///< as the area has it, its moments not yet those of grey values
  };

  /// A dot that the local Canny found, and as FitModel has it. Light that changes along an
  /// edge may draw the fit aside, and with it the ring's sectors: they are read by the former.
  struct CannyDot {
    TargetEdge edge, found;
  };

  /// What a fit may need beyond its start's ellipse and DotFitter's reach.
  static constexpr double kMoreReachPx = 2.0;

  GreyWindow WindowOf(const EllipseFrame& frame, double more_px);
  std::optional<Start> BeginAt(const DotRegion& region, double blur_px, GreyWindow* window);
  std::optional<PictureModel> LearnFrom(const std::vector<DotRegion>& regions,
                                        const std::vector<int>& order);
  bool IsClearlyDot(const ModelFit& fit) const;
  std::optional<ModelFit> FitByModel(const DotStart& dot, const GreyWindow& window);
  std::optional<TargetEdge> EdgeOfDot(const ModelFit& fit, const EllipseFrame& frame);
  std::optional<TargetEdge> MeasureByModel(const Start& start, const GreyWindow& window);
  std::optional<DotStart> BeginAtExpected(const ExpectedDot& dot, GreyWindow* window);
  std::optional<DotStart> LookAtExpected(const ExpectedDot& dot, GreyWindow* window);
  std::optional<TargetEdge> FitExpected(const ExpectedDot& dot, const DotStart& start,
                                        const GreyWindow& window);
  std::optional<TargetEdge> FollowUnclear(const ExpectedDot& dot, const ModelFit& fit);
  bool MeasureExpectedDot(const ExpectedDot& dot);
  bool AddExpected(const ExpectedDot& dot, const TargetEdge& edge);
  void PrefetchExpected(const Ellipse& ellipse) const;
  std::optional<CannyDot> MeasureByLocalCanny(const DotStart& dot);
  std::optional<DotStart> CutOutLow(const DotStart& dot);
  std::optional<CannyDot> MeasureUnclearAt(const Start& start);
  double UsualBlur() const { return picture_ ? picture_->blur_px : DotFitter::kUsualBlurPx; }
  void MeasureUnclear();
  /// @param ring_dot  the same dot as the ring is to be read by.
  void Add(const TargetEdge& edge, const TargetEdge& ring_dot);
  void Add(const Target& target);
  RingReading ReadRingOf(const TargetEdge& dot);
  void ReadRingAgain(const TargetEdge& dot, RingReading* ring);
  bool HasSize(const Ellipse& ellipse) const;
  /// Whether a target of much the same size is there.
  bool IsMeasured(const Eigen::Vector2d& center, double area_px2) const;

  const RecognitionOptions& options_;
  const CodeFamily& family_;
  const int gradient_threshold_;  ///< of the search
  WindowReader reader_;
  GreySampler sampler_;
  DotFitter fitter_;
  std::optional<PictureModel> picture_;
  InsideOfDots inside_;
  std::vector<Start> unclear_;
  std::vector<Target> targets_;
  PlaceIndex places_;  ///< of the targets
  RingPlaces rings_;
};

}  // namespace videogrammetry
