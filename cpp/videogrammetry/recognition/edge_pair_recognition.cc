#include "videogrammetry/recognition/edge_pair_recognition.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <tuple>
#include <utility>

#include "videogrammetry/core/median.h"
#include "videogrammetry/recognition/dot_look.h"
#include "videogrammetry/recognition/model_pool.h"
#include "videogrammetry/recognition/place_index.h"
#include "videogrammetry/recognition/window_picture.h"

namespace videogrammetry {
namespace {

/// Dots that noise, blur and light are learned from at most.
constexpr std::size_t kLearnFrom = 12;
/// Of these, those whose residuals, in units of the contrast, are no more than this
/// many times those of the better quarter: clutter teaches nothing.
constexpr double kMostResidual = 2.0;
/// Part of the residuals that is not noise, in units of the contrast, up to which the
/// model of a dot is right.
constexpr double kDot = 0.03;
/// The least such part that the noise lets be seen, beyond which it says nothing: that of
/// a contrast of eight times the noise.
constexpr double kBlind = 0.07;
/// A dot's error in units of blur times flare, light that is added on the darker side where
/// DotFitter's multiplies: 1.25 for the half-way level, as much again for the light that the
/// fit tilts to it. And the error from which on FitModel, which has flare, is worth its time.
constexpr double kFlareLever = 2.5, kFlarePx = 0.01;
/// What flare may be over its standard deviation: shadows and reflections have edges.
constexpr double kFlareTails = 3.0;
/// A dot's axes change by no more than this part from frame to frame.
constexpr double kMostResized = 0.25;
/// Standard deviation of the edge's place in a strip one pixel wide: Cramer and Rao's
/// for an edge of blur s, noise n and contrast C is sqrt(2 sqrt(pi) s) n / C.
double EdgeRms(const ModelFit& fit, const GreyNoise& noise) {
  const double variance = fit.variance_factor * noise.Variance(0.5 * (fit.inside + fit.outside));
  const double strip = 2.0 * std::sqrt(std::numbers::pi) * fit.blur_px;
  return std::sqrt(strip * variance) / (fit.inside - fit.outside);
}

TargetEdge EdgeOf(const ModelFit& fit, const GreyNoise& noise) {
  TargetEdge edge;
  edge.ellipse = fit.ellipse;
  edge.cov = fit.cov;
  edge.edge_rms_px = EdgeRms(fit, noise);
  edge.exact_axes = true;
  edge.inside = fit.inside;
  edge.outside = fit.outside;
  edge.width_px = std::sqrt(fit.blur_px * fit.blur_px + 1.0 / 12.0);
  return edge;
}

/// Whether the residuals hold no more than noise and what a dot's may, and the noise is
/// not such that they tell nothing.
bool IsClear(const ModelFit& fit, const GreyNoise& noise) {
  const double chance = 3.0 * std::sqrt(2.0 / fit.pixels);
  const double excess = std::max(0.0, fit.plain_factor - 1.0 - chance);
  const double contrast = fit.inside - fit.outside;
  const double unit = noise.Variance(0.5 * (fit.inside + fit.outside)) / (contrast * contrast);
  return excess * unit <= kDot * kDot && chance * unit <= kBlind * kBlind;
}

/// The areas' order, equal from wherever they come: of the whole picture or of a part of it.
std::vector<int> FromTheLargest(const std::vector<DotRegion>& regions) {
  std::vector<int> order(regions.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    const ContourMoments &m = regions[static_cast<std::size_t>(a)].moments,
                         &n = regions[static_cast<std::size_t>(b)].moments;
    return std::tuple(-m.area, m.mean_y, m.mean_x) < std::tuple(-n.area, n.mean_y, n.mean_x);
  });
  return order;
}

/// Judges dots by their residuals' variances, and by the noise that was made of these.
///
/// Chords are broken, more often than not, where four deviations of a difference exceed the
/// threshold by 1.4. Light's own noise does that on bright dots alone, and its variance is no
/// more than proportional to the grey value: the line through those of both sides of the edge
/// has nothing left at the camera's black level, which may stand at half of the darker side.
/// What is steeper, or there on the darker side too, is texture, compression or gleam.
InsideOfDots Judge(const std::vector<ModelFit>& fits, int gradient_threshold,
                   const GreyNoise& noise) {
  constexpr double kBroken = 1.4, kDeviations = 4.0 * std::numbers::sqrt2;
  std::vector<double> variances, darker;
  for (const ModelFit& fit : fits) {
    variances.push_back(fit.inside_variance.value_or(fit.variance));
    darker.push_back(std::abs(fit.inside) < std::abs(fit.outside) ? fit.inside : fit.outside);
  }
  const double most = kBroken * gradient_threshold;
  const double step = kDeviations * std::sqrt(Median(std::move(variances)));
  if (step <= most) return {DotInside::kEven, step};
  const double dark = noise.Variance(Median(std::move(darker)));
  const bool is_noise =
      noise.per_grey != 0.0 && noise.at_zero > -dark && kDeviations * std::sqrt(dark) <= most;
  return {is_noise ? DotInside::kNoisy : DotInside::kTextured, step};
}

/// Takes noise back to what the picture's ground may have: the search's threshold is at
/// least four deviations of a difference. Where something covers a part of most dots their
/// residuals are no noise.
void LimitNoise(const std::vector<ModelFit>& fits, int gradient_threshold, GreyNoise* noise) {
  constexpr double kMostNoise = 3.0;
  double contrast = 0.0, variance = 0.0;
  for (const ModelFit& fit : fits) {
    contrast += (fit.inside - fit.outside) / static_cast<double>(fits.size());
    variance += noise->Variance(fit.outside) / static_cast<double>(fits.size());
  }
  // (what is clear may have 3 % of the contrast beyond noise: less than that is no matter)
  const double most = std::max(kMostNoise * gradient_threshold / (4.0 * std::numbers::sqrt2),
                               1.5 * kDot * contrast);
  if (variance <= most * most) return;
  const double part = most * most / variance;
  noise->at_zero *= part;
  noise->per_grey *= part;
  noise->least = std::max(1.0 / 12.0, part * noise->least);
}

/// The flare that dots have in common beyond chance, or 0. The median of a gradient's
/// square is 2 ln 2 times the variance of a coordinate.
double PoolFlare(const std::vector<FlareSample>& flares) {
  // Twelve dots' squares over their variances scatter by 0.29 about 1; one dot's glare is
  // not the picture's.
  constexpr double kSignificant = 2.0, kMostSquares = 8.0;
  if (flares.empty()) return 0.0;
  double sum = 0.0, noise = 0.0;
  std::vector<double> squares;
  for (const FlareSample& flare : flares) {
    sum += std::min(kMostSquares, 0.5 * flare.square / flare.noise);
    noise += flare.noise;
    squares.push_back(flare.square);
  }
  const auto count = static_cast<double>(flares.size());
  if (sum < kSignificant * count) return 0.0;
  const double square = Median(std::move(squares));
  return std::sqrt(std::max(0.0, square / (2.0 * std::numbers::ln2) - noise / count));
}

/// Whether a dot's place is known so badly, in its radii, that sectors may be missed.
bool IsVague(const TargetEdge& dot) {
  constexpr double kVague = 0.01;
  const double most = kVague * dot.ellipse.semi_minor_px;
  return std::max(dot.cov(0, 0), dot.cov(1, 1)) > most * most;
}

}  // namespace

bool ExpectedDot::IsLike(const Ellipse& other) const {
  const Ellipse& e = edge.ellipse;
  const double most = kMostResized * e.semi_major_px;
  return std::abs(other.semi_major_px - e.semi_major_px) < most &&
         std::abs(other.semi_minor_px - e.semi_minor_px) < most;
}

EdgePairRecognition::EdgePairRecognition(const FrameView& frame, const RecognitionOptions& options,
                                         const CodeFamily& family, int gradient_threshold)
    : options_(options),
      family_(family),
      gradient_threshold_(gradient_threshold),
      reader_(frame, options.polarity == Polarity::kWhiteOnBlack ? 1 : -1),
      sampler_(frame, reader_.sign()),
      places_(reader_.width(), reader_.height()),
      rings_(family, reader_.width(), reader_.height()) {}

GreyWindow EdgePairRecognition::WindowOf(const EllipseFrame& frame, double more_px) {
  const Eigen::Matrix2d& e = frame.shape;
  const double x = std::sqrt(e(0, 0) * e(0, 0) + e(0, 1) * e(0, 1)) + more_px;
  const double y = std::sqrt(e(0, 1) * e(0, 1) + e(1, 1) * e(1, 1)) + more_px;
  const auto floor = [](double v) { return static_cast<int>(std::floor(v)); };
  return reader_.Read(floor(frame.center.x() - x), floor(frame.center.y() - y),
                      floor(frame.center.x() + x) + 1, floor(frame.center.y() + y) + 1);
}

std::optional<EdgePairRecognition::Start> EdgePairRecognition::BeginAt(const DotRegion& region,
                                                                       double blur_px,
                                                                       GreyWindow* window) {
  const ContourMoments& m = region.moments;
  const auto shape = ShapeOfMoments(m.var_xx, m.var_xy, m.var_yy);
  if (!shape) return std::nullopt;
  DotStart dot = {{{m.mean_x, m.mean_y}, *shape}, region.inside, region.outside};
  if (!MeasureGrey(sampler_, &dot)) return std::nullopt;
  *window = WindowOf(dot.frame, DotFitter::Reach(blur_px) + kMoreReachPx);
  Resize(region.level(), blur_px, &dot);
  const auto begun = fitter_.Begin(*window, dot, blur_px);
  return Start{begun ? *begun : dot, dot};
}

std::optional<PictureModel> EdgePairRecognition::LearnFrom(const std::vector<DotRegion>& regions,
                                                           const std::vector<int>& order) {
  struct Lesson {
    DotStart start;
    ModelFit fit;
    double residual;
  };
  std::vector<Lesson> lessons;
  // Twice as many as wanted: half of the areas are none.
  const std::size_t step = std::max<std::size_t>(1, order.size() / (2 * kLearnFrom));
  GreyWindow window;
  for (std::size_t i = 0; i < order.size() && lessons.size() < kLearnFrom; i += step) {
    const DotRegion& region = regions[static_cast<std::size_t>(order[i])];
    const auto start = BeginAt(region, DotFitter::kUsualBlurPx, &window);
    if (!start) continue;
    const auto fit = fitter_.Fit(window, start->dot, nullptr, true);
    if (!fit || !HasSize(fit->ellipse)) continue;
    lessons.push_back({start->dot, *fit, std::sqrt(fit->variance) / (fit->inside - fit->outside)});
  }
  if (lessons.empty()) return std::nullopt;
  std::sort(lessons.begin(), lessons.end(),
            [](const Lesson& a, const Lesson& b) { return a.residual < b.residual; });
  const double most = kMostResidual * lessons[lessons.size() / 4].residual;
  std::erase_if(lessons, [&](const Lesson& lesson) { return lesson.residual > most; });
  std::vector<ModelFit> fits;
  for (const Lesson& lesson : lessons) fits.push_back(lesson.fit);
  auto picture = PoolModels(fits);
  inside_ = Judge(fits, gradient_threshold_, picture->noise);
  // How even the light is shows with the noise known only.
  std::vector<FlareSample> flares;
  fits.clear();
  for (const Lesson& lesson : lessons) {
    window = WindowOf(lesson.start.frame, DotFitter::Reach(picture->blur_px) + kMoreReachPx);
    const auto fit = fitter_.Fit(window, lesson.start, &*picture, true);
    if (!fit) continue;
    fits.push_back(*fit);
    if (const auto flare = MeasureFlare(window, *fit)) flares.push_back(*flare);
  }
  picture->gradient = PoolGradient(fits);
  LimitNoise(fits, gradient_threshold_, &picture->noise);
  const double flare = PoolFlare(flares);
  if (kFlareLever * picture->blur_px * flare > kFlarePx) picture->flare = kFlareTails * flare;
  return picture;
}

bool EdgePairRecognition::HasSize(const Ellipse& e) const {
  return 2.0 * e.semi_minor_px >= options_.diameter_px[0] &&
         2.0 * e.semi_major_px <= options_.diameter_px[1];
}

std::optional<ModelFit> EdgePairRecognition::FitByModel(const DotStart& dot,
                                                        const GreyWindow& window) {
  if (!picture_ || options_.estimator == Estimator::kMeanGradient) return std::nullopt;
  return fitter_.Fit(window, dot, &*picture_);
}

bool EdgePairRecognition::IsClearlyDot(const ModelFit& fit) const {
  return IsClear(fit, picture_->noise);
}

/// @return nullopt if the dot has not the size asked for.
std::optional<TargetEdge> EdgePairRecognition::EdgeOfDot(const ModelFit& fit,
                                                         const EllipseFrame& frame) {
  if (!HasSize(fit.ellipse)) return std::nullopt;
  TargetEdge edge = EdgeOf(fit, picture_->noise);
  if (picture_->flare > PictureModel{}.flare) {
    const WindowPicture local(WindowOf(frame, kMostReachPx), reader_.sign());
    local.Refine(&*picture_, &edge);
  }
  return edge;
}

/// What is not clearly a dot goes to unclear_.
std::optional<TargetEdge> EdgePairRecognition::MeasureByModel(const Start& start,
                                                              const GreyWindow& window) {
  const auto fit = FitByModel(start.dot, window);
  if (fit && IsClearlyDot(*fit)) return EdgeOfDot(*fit, start.dot.frame);
  unclear_.push_back(start);
  return std::nullopt;
}

RingReading EdgePairRecognition::ReadRingOf(const TargetEdge& dot) {
  if (family_.num_bits == 0) return {};
  RingReading ring = ReadRing(sampler_, dot, family_, options_.direction);
  // (a second chance for every ring would let prints of other families through)
  if (IsVague(dot) && !ring.id && ring.status != RingStatus::kNoRing) ReadRingAgain(dot, &ring);
  return ring;
}

void EdgePairRecognition::Add(const TargetEdge& edge, const TargetEdge& ring_dot) {
  if (!IsKnown(edge.ellipse, targets_, places_)) Add(Target{edge, ReadRingOf(ring_dot)});
}

void EdgePairRecognition::Add(const Target& target) {
  const Ellipse& e = target.edge.ellipse;
  places_.Insert(e.x_px, e.y_px, static_cast<int>(targets_.size()));
  if (family_.num_bits > 0) rings_.Add(target);
  targets_.push_back(target);
}

bool EdgePairRecognition::IsMeasured(const Eigen::Vector2d& center, double area) const {
  const double reach = 0.1 * std::sqrt(area / std::numbers::pi) + 0.3;
  return places_.AnyNear(center.x(), center.y(), reach, [&](int number) {
    const Ellipse& e = targets_[static_cast<std::size_t>(number)].edge.ellipse;
    const double ratio = area / (std::numbers::pi * e.semi_major_px * e.semi_minor_px);
    return ratio > 0.5 && ratio < 2.0;
  });
}

void EdgePairRecognition::Learn(const std::vector<DotRegion>& regions) {
  picture_ = LearnFrom(regions, FromTheLargest(regions));
}

std::vector<Target> EdgePairRecognition::Measure(const std::vector<DotRegion>& regions) {
  const std::vector<int> order = FromTheLargest(regions);
  const double blur_px = UsualBlur();
  GreyWindow window;
  for (const int i : order) {
    const DotRegion& region = regions[static_cast<std::size_t>(i)];
    const ContourMoments& m = region.moments;
    const Eigen::Vector2d center(m.mean_x, m.mean_y);
    // (not less than the minor axis)
    const double minor =
        m.area / (2.0 * std::numbers::pi * std::sqrt(std::max(m.var_xx, m.var_yy)));
    if (rings_.Holds(center, minor) || IsMeasured(center, m.area)) continue;
    auto start = BeginAt(region, blur_px, &window);
    if (!start) continue;
    if (const auto edge = MeasureByModel(*start, window)) Add(*edge, *edge);
  }
  MeasureUnclear();
  std::sort(targets_.begin(), targets_.end(), [](const Target& a, const Target& b) {
    const Ellipse &e = a.edge.ellipse, &f = b.edge.ellipse;
    return e.y_px != f.y_px ? e.y_px < f.y_px : e.x_px < f.x_px;
  });
  return std::move(targets_);
}

}  // namespace videogrammetry
