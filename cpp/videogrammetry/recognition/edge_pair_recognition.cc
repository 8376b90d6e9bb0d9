#include "videogrammetry/recognition/edge_pair_recognition.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "videogrammetry/recognition/dot_look.h"
#include "videogrammetry/recognition/model_pool.h"
#include "videogrammetry/recognition/place_index.h"

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
/// The second search: threshold over the first one's, and least diameter. Texture breaks
/// a chord in proportion to its length: dots below are as well found by the first.
constexpr int kSecondThreshold = 3;
constexpr double kSecondDiameterPx = 8.0;
/// What a fit may need beyond its start's ellipse.
constexpr double kMoreReachPx = 1.5;
/// What the local Canny may look at beyond an ellipse.
constexpr double kUnclearReachPx = 10.0;
/// How much larger a dot may be than the gleam on it, in radii of that.
constexpr double kMostGleam = 2.0;

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
  edge.inside = fit.inside;
  edge.outside = fit.outside;
  edge.width_px = std::sqrt(fit.blur_px * fit.blur_px + 1.0 / 12.0);
  return edge;
}

/// Whether the residuals hold no more than noise and what a dot's may, and the noise is
/// not such that they tell nothing.
bool IsClear(const ModelFit& fit, const GreyNoise& noise) {
  const double chance = 3.0 * std::sqrt(2.0 / fit.pixels);
  const double excess = std::max(0.0, fit.variance_factor - 1.0 - chance);
  const double contrast = fit.inside - fit.outside;
  const double unit = noise.Variance(0.5 * (fit.inside + fit.outside)) / (contrast * contrast);
  return excess * unit <= kDot * kDot && chance * unit <= kBlind * kBlind;
}

/// The flare that dots have in common beyond chance, or 0.
double PoolFlare(const std::vector<FlareSample>& flares) {
  // Twelve dots' squares over their variances scatter by 0.29 about 1; one dot's glare is
  // not the picture's.
  constexpr double kSignificant = 2.0, kMostSquares = 8.0;
  if (flares.empty()) return 0.0;
  double sum = 0.0, noise = 0.0;
  for (const FlareSample& flare : flares) {
    sum += std::min(kMostSquares, 0.5 * flare.square / flare.noise);
    noise += flare.noise;
  }
  const auto count = static_cast<double>(flares.size());
  const double ratio = sum / count;
  return ratio > kSignificant ? std::sqrt((ratio - 1.0) * noise / count) : 0.0;
}

/// A window's samples as a picture of its own, so that every depth's are the same.
class WindowPicture {
 public:
  WindowPicture(const GreyWindow& window, int sign)
      : x0_(window.x0),
        y0_(window.y0),
        samples_(Samples(window, sign)),
        image_(ImageView16(samples_.data(), window.width, window.height), sign) {}
  WindowPicture(const WindowPicture&) = delete;
  WindowPicture& operator=(const WindowPicture&) = delete;

  const SignedImage<std::uint16_t>& image() const { return image_; }
  Ellipse Inwards(Ellipse e) const { return Moved(e, -1); }
  Ellipse Outwards(Ellipse e) const { return Moved(e, 1); }

  /// Measures an edge anew by FitModel; if that fails or leaves it, it stays.
  void Refine(const PictureModel* picture, TargetEdge* edge) const {
    TargetEdge local = *edge;
    local.ellipse = Inwards(edge->ellipse);
    const auto fit = FitModel(image_, local, picture);
    if (!fit || HasLeft(local.ellipse, fit->ellipse)) return;
    edge->ellipse = Outwards(fit->ellipse);
    edge->cov = fit->cov;
    edge->inside = fit->inside;
    edge->outside = fit->outside;
  }

 private:
  static std::vector<std::uint16_t> Samples(const GreyWindow& window, int sign) {
    std::vector<std::uint16_t> samples;
    samples.reserve(static_cast<std::size_t>(window.width) *
                    static_cast<std::size_t>(window.height));
    for (int y = window.y0; y < window.y0 + window.height; ++y) {
      for (int x = window.x0; x < window.x0 + window.width; ++x) {
        samples.push_back(static_cast<std::uint16_t>(static_cast<float>(sign) * window(x, y)));
      }
    }
    return samples;
  }
  Ellipse Moved(Ellipse e, int direction) const {
    e.x_px += direction * x0_;
    e.y_px += direction * y0_;
    return e;
  }

  int x0_, y0_;
  std::vector<std::uint16_t> samples_;
  SignedImage<std::uint16_t> image_;
};

/// Whether an area was found before: at another threshold a level moves a border by
/// half a pixel.
bool IsSameArea(const ContourMoments& a, const ContourMoments& b) {
  return std::abs(a.width_px - b.width_px) <= 2 && std::abs(a.height_px - b.height_px) <= 2;
}

}  // namespace

std::vector<DotRegion> FindDotAreas(const FrameView& frame, const RecognitionOptions& options,
                                    int gradient_threshold) {
  const int sign = options.polarity == Polarity::kWhiteOnBlack ? 1 : -1;
  auto areas = FindDotRegions(frame, sign, options.diameter_px, gradient_threshold);
  const double least = std::max(options.diameter_px[0], kSecondDiameterPx);
  if (least >= options.diameter_px[1]) return areas;
  PlaceIndex index;
  for (std::size_t i = 0; i < areas.size(); ++i) {
    index.Insert(areas[i].moments.mean_x, areas[i].moments.mean_y, static_cast<int>(i));
  }
  const std::size_t first = areas.size();
  for (const DotRegion& area : FindDotRegions(frame, sign, {least, options.diameter_px[1]},
                                              kSecondThreshold * gradient_threshold)) {
    const ContourMoments& m = area.moments;
    const bool known = index.AnyNear(m.mean_x, m.mean_y, 0.5, [&](int number) {
      return IsSameArea(areas[static_cast<std::size_t>(number)].moments, m);
    });
    if (!known) areas.push_back(area);
  }
  if (areas.size() > first) {
    std::stable_sort(areas.begin(), areas.end(), [](const DotRegion& a, const DotRegion& b) {
      return a.moments.mean_y < b.moments.mean_y;
    });
  }
  return areas;
}

EdgePairRecognition::EdgePairRecognition(const FrameView& frame, const RecognitionOptions& options)
    : options_(options), reader_(frame, options.polarity == Polarity::kWhiteOnBlack ? 1 : -1) {}

GreyWindow EdgePairRecognition::WindowOf(const EllipseFrame& frame, double more_px) {
  const Eigen::Vector2d reach = frame.shape.rowwise().norm() + Eigen::Vector2d::Constant(more_px);
  const Eigen::Vector2d low = frame.center - reach, high = frame.center + reach;
  return reader_.Read(static_cast<int>(std::floor(low.x())), static_cast<int>(std::floor(low.y())),
                      static_cast<int>(std::ceil(high.x())), static_cast<int>(std::ceil(high.y())));
}

std::optional<EdgePairRecognition::Start> EdgePairRecognition::BeginAt(const DotRegion& region,
                                                                       double blur_px) {
  const ContourMoments& m = region.moments;
  const auto shape = ShapeOfMoments(m.var_xx, m.var_xy, m.var_yy);
  if (!shape) return std::nullopt;
  DotStart dot = {{{m.mean_x, m.mean_y}, *shape}, region.inside, region.outside};
  const GreyWindow window = WindowOf(dot.frame, DotFitter::Reach(blur_px) + kMoreReachPx);
  if (!MeasureGrey(window, &dot)) return std::nullopt;
  Resize(region.level(), blur_px, &dot);
  const auto begun = fitter_.Begin(window, dot, blur_px);
  return Start{begun ? *begun : dot, dot, 0};
}

std::optional<PictureModel> EdgePairRecognition::Learn(const std::vector<Start>& starts) {
  struct Lesson {
    const Start* start;
    ModelFit fit;
    double residual;
  };
  std::vector<Lesson> lessons;
  const std::size_t step = std::max<std::size_t>(1, starts.size() / kLearnFrom);
  const double more = DotFitter::Reach(1.0) + kMoreReachPx;
  for (std::size_t i = 0; i < starts.size(); i += step) {
    const GreyWindow window = WindowOf(starts[i].dot.frame, more);
    const auto fit = fitter_.Fit(window, starts[i].dot, nullptr, true);
    if (!fit || !HasSize(fit->ellipse)) continue;
    lessons.push_back({&starts[i], *fit, std::sqrt(fit->variance) / (fit->inside - fit->outside)});
  }
  if (lessons.empty()) return std::nullopt;
  std::sort(lessons.begin(), lessons.end(),
            [](const Lesson& a, const Lesson& b) { return a.residual < b.residual; });
  const double most = kMostResidual * lessons[lessons.size() / 4].residual;
  std::erase_if(lessons, [&](const Lesson& lesson) { return lesson.residual > most; });
  std::vector<ModelFit> fits;
  for (const Lesson& lesson : lessons) fits.push_back(lesson.fit);
  auto picture = PoolModels(fits);
  // How even the light is shows with the noise known only.
  std::vector<FlareSample> flares;
  fits.clear();
  for (const Lesson& lesson : lessons) {
    const GreyWindow window = WindowOf(lesson.start->dot.frame, more);
    const auto fit = fitter_.Fit(window, lesson.start->dot, &*picture, true);
    if (!fit) continue;
    fits.push_back(*fit);
    if (const auto flare = MeasureFlare(window, *fit)) flares.push_back(*flare);
  }
  picture->gradient = PoolGradient(fits);
  const double flare = PoolFlare(flares);
  if (kFlareLever * picture->blur_px * flare > kFlarePx) {
    picture->flare = kFlareTails * flare;
  }
  return picture;
}

bool EdgePairRecognition::HasSize(const Ellipse& e) const {
  return 2.0 * e.semi_minor_px >= options_.diameter_px[0] &&
         2.0 * e.semi_major_px <= options_.diameter_px[1];
}

/// What is not clearly a dot goes to unclear_.
std::optional<TargetEdge> EdgePairRecognition::MeasureByModel(const Start& start) {
  const bool by_model = picture_ && options_.estimator != Estimator::kMeanGradient;
  std::optional<ModelFit> fit;
  if (by_model) {
    const double reach = DotFitter::Reach(picture_->blur_px) + kMoreReachPx;
    fit = fitter_.Fit(WindowOf(start.dot.frame, reach), start.dot, &*picture_);
  }
  if (!fit || !IsClear(*fit, picture_->noise)) {
    unclear_.push_back(start);
    return std::nullopt;
  }
  if (!HasSize(fit->ellipse)) return std::nullopt;
  TargetEdge edge = EdgeOf(*fit, picture_->noise);
  if (picture_->flare > PictureModel{}.flare) {
    const WindowPicture local(WindowOf(start.dot.frame, kUnclearReachPx), reader_.sign());
    local.Refine(&*picture_, &edge);
  }
  return edge;
}

std::optional<TargetEdge> EdgePairRecognition::MeasureByLocalCanny(const DotStart& dot) {
  const WindowPicture local(WindowOf(dot.frame, kUnclearReachPx), reader_.sign());
  Candidate candidate;
  candidate.ellipse = local.Inwards(dot.frame.ToEllipse());
  candidate.inside = static_cast<float>(dot.inside);
  candidate.level = static_cast<float>(0.5 * (dot.inside + dot.outside));
  auto edge = MeasureTargetEdge(local.image(), candidate, options_);
  if (!edge) return std::nullopt;
  edge->ellipse = local.Outwards(edge->ellipse);
  if (options_.estimator == Estimator::kModel)
    local.Refine(picture_ ? &*picture_ : nullptr, &*edge);
  return edge;
}

std::optional<TargetEdge> EdgePairRecognition::MeasureUnclearAt(const Start& start) {
  if (auto edge = MeasureByLocalCanny(start.dot)) return edge;
  // What lies beyond a narrow rim draws the moments aside,
  if (auto edge = MeasureByLocalCanny(start.cut_out)) return edge;
  // and a gleam hides the rest of its dot.
  const double more =
      kMostGleam * std::sqrt(start.cut_out.frame.shape.determinant()) + kUnclearReachPx;
  const auto low = CutOutLow(WindowOf(start.cut_out.frame, more), start.cut_out, blur_px());
  return low ? MeasureByLocalCanny(*low) : std::nullopt;
}

std::vector<DotMeasurement> EdgePairRecognition::MeasureClear(const std::vector<DotRegion>& regions,
                                                              const CameraModel* camera) {
  const double blur_px = camera ? camera->picture.blur_px : DotFitter::kUsualBlurPx;
  std::vector<Start> starts;
  PlaceIndex index;
  // A dot that was found at two levels begins at the same place twice.
  const auto is_same = [&](const EllipseFrame& frame) {
    const double area = frame.shape.determinant(), reach = 0.1 * std::sqrt(area);
    return index.AnyNear(frame.center.x(), frame.center.y(), reach, [&](int number) {
      const double other = starts[static_cast<std::size_t>(number)].dot.frame.shape.determinant();
      return std::abs(area - other) < 0.2 * area;
    });
  };
  for (std::size_t i = 0; i < regions.size(); ++i) {
    auto start = BeginAt(regions[i], blur_px);
    if (!start || is_same(start->dot.frame)) continue;
    start->region = static_cast<int>(i);
    const Eigen::Vector2d& center = start->dot.frame.center;
    index.Insert(center.x(), center.y(), static_cast<int>(starts.size()));
    starts.push_back(*start);
  }
  picture_ = camera ? std::optional(camera->picture) : Learn(starts);
  unclear_.clear();
  std::vector<DotMeasurement> dots;
  for (const Start& start : starts) {
    if (const auto edge = MeasureByModel(start)) dots.push_back({*edge, start.region});
  }
  return dots;
}

std::vector<DotMeasurement> EdgePairRecognition::MeasureUnclear(
    const std::function<bool(const Ellipse&)>& leave_out) {
  std::vector<DotMeasurement> dots;
  for (const Start& start : unclear_) {
    if (leave_out(start.dot.frame.ToEllipse())) continue;
    const auto edge = MeasureUnclearAt(start);
    if (edge) dots.push_back({*edge, start.region});
  }
  return dots;
}

}  // namespace videogrammetry
