// What is not clearly a dot: the local Canny decides, and FitModel measures.

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>

#include "videogrammetry/recognition/candidate_search.h"
#include "videogrammetry/recognition/contour.h"
#include "videogrammetry/recognition/dot_look.h"
#include "videogrammetry/recognition/edge_pair_recognition.h"
#include "videogrammetry/recognition/target_edge.h"
#include "videogrammetry/recognition/window_picture.h"

namespace videogrammetry {
namespace {

/// Part of the contrast at which a dot with a gleam is cut out anew.
constexpr double kLowLevel = 0.2;
/// How much larger a dot may be than the gleam on it, in radii of that.
constexpr double kMostGleam = 2.0;

/// Moments of the area at or above a level around a dot's middle.
/// @return nullopt if there is none, or it is ragged or leaves the picture.
std::optional<ContourMoments> AreaAt(const SignedImage<std::uint16_t>& image, const Ellipse& dot,
                                     double grey_level) {
  const int level = static_cast<int>(std::ceil(grey_level));
  int x = static_cast<int>(std::lround(dot.x_px));
  const int y = static_cast<int>(std::lround(dot.y_px));
  if (x < 1 || y < 1 || x + 1 >= image.width() || y + 1 >= image.height()) return std::nullopt;
  if (image(x, y) < level) return std::nullopt;
  while (x > 0 && image(x - 1, y) >= level) --x;
  if (x == 0) return std::nullopt;
  ContourFollower<std::uint16_t> contour(image, std::max(image.width(), image.height()));
  if (contour.Follow(x, y, level) != ContourEnd::kClosed) return std::nullopt;
  return contour.Moments();
}

}  // namespace

std::optional<EdgePairRecognition::CannyDot> EdgePairRecognition::MeasureByLocalCanny(
    const DotStart& dot) {
  const WindowPicture local(WindowOf(dot.frame, kMostReachPx), reader_.sign());
  Candidate candidate;
  candidate.ellipse = local.Inwards(dot.frame.ToEllipse());
  candidate.inside = static_cast<float>(dot.inside);
  candidate.level = static_cast<float>(0.5 * (dot.inside + dot.outside));
  // As in the local Canny's search: what something covers in part is no ellipse.
  const auto area = AreaAt(local.image(), candidate.ellipse, candidate.level);
  if (!area || !IsLikeEllipse(*area)) return std::nullopt;
  auto edge = MeasureTargetEdge(local.image(), candidate, options_);
  if (!edge) return std::nullopt;
  edge->ellipse = local.Outwards(edge->ellipse);
  CannyDot measured = {*edge, *edge};
  if (options_.estimator == Estimator::kModel) {
    local.Refine(picture_ ? &*picture_ : nullptr, &measured.edge);
  }
  return measured;
}

/// Cuts a dot out anew, at a fifth of the contrast: a gleam on a part of it makes the rest
/// darker than half-way.
std::optional<DotStart> EdgePairRecognition::CutOutLow(const DotStart& dot) {
  const double more = kMostGleam * std::sqrt(dot.frame.shape.determinant()) + kMostReachPx;
  const GreyWindow window = WindowOf(dot.frame, more);
  const WindowPicture local(window, reader_.sign());
  const double level = dot.outside + kLowLevel * (dot.inside - dot.outside);
  const auto area = AreaAt(local.image(), local.Inwards(dot.frame.ToEllipse()), level);
  const auto shape = area ? ShapeOfMoments(area->var_xx, area->var_xy, area->var_yy) : std::nullopt;
  if (!shape) return std::nullopt;
  const Eigen::Vector2d center(area->mean_x + window.x0, area->mean_y + window.y0);
  DotStart low = {{center, *shape}, dot.inside, dot.outside};
  Resize(level, UsualBlur(), &low);
  if (!MeasureGrey(sampler_, &low)) return std::nullopt;
  return low;
}

std::optional<EdgePairRecognition::CannyDot> EdgePairRecognition::MeasureUnclearAt(
    const Start& start) {
  if (auto edge = MeasureByLocalCanny(start.dot)) return edge;
  // What lies beyond a narrow rim draws the moments aside,
  if (auto edge = MeasureByLocalCanny(start.cut_out)) return edge;
  // and a gleam hides the rest of its dot.
  const auto low = CutOutLow(start.cut_out);
  return low ? MeasureByLocalCanny(*low) : std::nullopt;
}

/// Reads a ring by the dot as the local Canny finds it; what has an ID then replaces the
/// reading.
void EdgePairRecognition::ReadRingAgain(const TargetEdge& dot, RingReading* ring) {
  const auto canny =
      MeasureByLocalCanny({EllipseFrame::From(dot.ellipse), dot.inside, dot.outside});
  if (!canny) return;
  const RingReading again = ReadRing(sampler_, canny->found, family_, options_.direction);
  if (again.id) *ring = again;
}

void EdgePairRecognition::MeasureUnclear() {
  for (const Start& start : unclear_) {
    const Ellipse e = start.dot.frame.ToEllipse();
    if (rings_.Holds(start.dot.frame.center, e.semi_minor_px)) continue;
    if (IsKnown(e, targets_, places_)) continue;
    const auto dot = MeasureUnclearAt(start);
    if (dot) Add(dot->edge, dot->found);
  }
}

}  // namespace videogrammetry
