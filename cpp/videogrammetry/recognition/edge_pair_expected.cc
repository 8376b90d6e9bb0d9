// Dots that the picture before lets be expected: measured where they are, without a search.

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "videogrammetry/recognition/dot_look.h"
#include "videogrammetry/recognition/edge_pair_recognition.h"
#include "videogrammetry/recognition/window_picture.h"

namespace videogrammetry {
namespace {

/// A dot this near to its place has its pixels around it.
constexpr double kNearExpectedPx = 0.5;
/// Grey values that have changed by more than this part of the contrast are looked at anew: a
/// fit that begins with wrong ones ends its first step aside by their part of it.
constexpr double kMostChanged = 0.02;
/// Moments cut off so many deviations of the noise at either end of the contrast, and no more
/// than this part of it: half of a dark ground's noise would count as bright. (More cuts off the
/// blurred edge's tails too: of 0, 0.5, 1, 2 deviations the first step of a fit is the shortest
/// with 0.5.)
constexpr double kCutOff = 0.5, kMostCutOff = 0.15;
/// The contrast of a dot that is unclear changes by no more than this factor.
constexpr double kMostContrast = 1.5;

DotStart StartOf(const ExpectedDot& dot) {
  return {EllipseFrame::From(dot.edge.ellipse), dot.edge.inside, dot.edge.outside};
}

bool IsLitOtherwise(const TargetEdge& before, const TargetEdge& now) {
  const double most = kMostChanged * (now.inside - now.outside);
  return !(std::abs(now.inside - before.inside) < most) ||
         !(std::abs(now.outside - before.outside) < most);
}

}  // namespace

/// Start of a fit where a dot is expected, with the grey values that it had.
/// @return nullopt if it is not near.
std::optional<DotStart> EdgePairRecognition::BeginAtExpected(const ExpectedDot& dot,
                                                             GreyWindow* window) {
  const DotStart expected = StartOf(dot);
  DotStart start = expected;
  if (picture_) {
    const double most = kMostCutOff * (start.inside - start.outside);
    const auto cut = [&](double grey) {
      return std::min(most, kCutOff * std::sqrt(picture_->noise.Variance(grey)));
    };
    start.inside -= cut(expected.inside);
    start.outside += cut(expected.outside);
  }
  *window = WindowOf(start.frame, DotFitter::Reach(UsualBlur()) + kMoreReachPx);
  const auto begun = fitter_.Begin(*window, start, UsualBlur());
  if (!begun || !((begun->frame.center - start.frame.center).norm() < kNearExpectedPx)) {
    return std::nullopt;
  }
  return DotStart{begun->frame, expected.inside, expected.outside};
}

/// The same for one that has moved on its own, or whose light has changed: a look around says
/// how bright it is, and its moments are taken again where they move it so far that the pixels
/// around its old place were the wrong ones.
std::optional<DotStart> EdgePairRecognition::LookAtExpected(const ExpectedDot& dot,
                                                            GreyWindow* window) {
  constexpr int kRounds = 4;
  const double blur_px = UsualBlur();
  DotStart start = StartOf(dot);
  for (int round = 0; round < kRounds; ++round) {
    DotStart looked = start;
    // (off its place it looks like none, and is found by the grey values that it had)
    const bool is_dot = MeasureGrey(sampler_, &looked);
    if (is_dot) start = looked;
    *window = WindowOf(start.frame, DotFitter::Reach(blur_px) + kMoreReachPx);
    const auto begun = fitter_.Begin(*window, start, blur_px);
    if (!begun) return std::nullopt;
    const double moved = (begun->frame.center - start.frame.center).norm();
    start = *begun;
    if (is_dot && moved < kNearExpectedPx) return start;
  }
  return std::nullopt;
}

/// A dot that the local Canny found in the picture before, and that is no clearer now: FitModel
/// measures it from where the fast fit has it.
std::optional<TargetEdge> EdgePairRecognition::FollowUnclear(const ExpectedDot& dot,
                                                             const ModelFit& fit) {
  const double before = dot.edge.inside - dot.edge.outside;
  TargetEdge edge = dot.edge;
  edge.ellipse = fit.ellipse;
  const WindowPicture local(WindowOf(EllipseFrame::From(fit.ellipse), kMostReachPx),
                            reader_.sign());
  if (!local.Refine(&*picture_, &edge)) return std::nullopt;
  const double now = edge.inside - edge.outside;
  const bool same = now < kMostContrast * before && before < kMostContrast * now;
  return same && dot.IsLike(edge.ellipse) && HasSize(edge.ellipse) ? std::optional(edge)
                                                                   : std::nullopt;
}

std::optional<TargetEdge> EdgePairRecognition::FitExpected(const ExpectedDot& dot,
                                                           const DotStart& start,
                                                           const GreyWindow& window) {
  const auto fit = FitByModel(start, window);
  if (!fit || !dot.IsLike(fit->ellipse)) return std::nullopt;
  if (IsClearlyDot(*fit)) return EdgeOfDot(*fit, start.frame);
  return dot.edge.exact_axes ? std::nullopt : FollowUnclear(dot, *fit);
}

/// @return false if its ring says that it is for a search to tell what it is.
bool EdgePairRecognition::AddExpected(const ExpectedDot& dot, const TargetEdge& edge) {
  const Ellipse& e = edge.ellipse;
  if (rings_.Holds({e.x_px, e.y_px}, e.semi_minor_px)) return false;
  if (IsKnown(e, targets_, places_)) return true;
  if (const auto same = FollowRing(sampler_, edge, family_, dot.ring)) {
    Add(Target{edge, *same});
    return true;
  }
  const Target target = {edge, ReadRingOf(edge)};
  // (the ring of an unclear dot is read by the dot as the local Canny finds it)
  if (!edge.exact_axes && target.ring.status != RingStatus::kNoRing) return false;
  Add(target);
  return true;
}

bool EdgePairRecognition::MeasureExpectedDot(const ExpectedDot& dot) {
  GreyWindow window;
  auto start = BeginAtExpected(dot, &window);
  auto edge = start ? FitExpected(dot, *start, window) : std::nullopt;
  if (!edge || IsLitOtherwise(dot.edge, *edge)) {
    edge.reset();
    start = LookAtExpected(dot, &window);
    if (start) edge = FitExpected(dot, *start, window);
  }
  return edge && AddExpected(dot, *edge);
}

/// What a dot's fit and its ring's middle will look at.
void EdgePairRecognition::PrefetchExpected(const Ellipse& e) const {
  const double ring = 0.5 * (family_.ring_inner + family_.ring_outer) * e.semi_major_px;
  const double reach =
      1.0 + std::max(family_.num_bits > 0 ? ring : 0.0,
                     e.semi_major_px + DotFitter::Reach(UsualBlur()) + kMoreReachPx);
  const auto floor = [](double v) { return static_cast<int>(std::floor(v)); };
  reader_.Prefetch(floor(e.x_px - reach), floor(e.y_px - reach), floor(e.x_px + reach),
                   floor(e.y_px + reach));
}

std::vector<int> EdgePairRecognition::MeasureExpected(const std::vector<ExpectedDot>& dots) {
  // The largest first, as in a search; far ahead of the work their memory is asked for.
  constexpr std::size_t kAhead = 3;
  std::vector<int> order(dots.size()), missing;
  std::iota(order.begin(), order.end(), 0);
  const auto ellipse = [&](int i) -> const Ellipse& {
    return dots[static_cast<std::size_t>(i)].edge.ellipse;
  };
  const auto area = [&](int i) { return ellipse(i).semi_major_px * ellipse(i).semi_minor_px; };
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return std::pair(-area(a), a) < std::pair(-area(b), b); });
  for (std::size_t k = 0; k < order.size() + kAhead; ++k) {
    if (k < order.size()) PrefetchExpected(ellipse(order[k]));
    if (k < kAhead) continue;
    const int i = order[k - kAhead];
    if (!MeasureExpectedDot(dots[static_cast<std::size_t>(i)])) missing.push_back(i);
  }
  return missing;
}

KnownParts EdgePairRecognition::MeasuredParts() const {
  // Of a dot its blurred edge too; a ring ends before the next target's begins.
  constexpr double kDot = 1.25, kBeyondRing = 0.1;
  KnownParts parts(reader_.width(), reader_.height());
  for (const Target& target : targets_) {
    const bool has_ring = target.ring.status == RingStatus::kCoded;
    parts.Add(target.edge.ellipse, has_ring ? family_.ring_outer + kBeyondRing : kDot);
  }
  return parts;
}

}  // namespace videogrammetry
