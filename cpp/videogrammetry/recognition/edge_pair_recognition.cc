#include "videogrammetry/recognition/edge_pair_recognition.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

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
/// The second search: threshold over the first one's, and least diameter. Texture breaks
/// a chord in proportion to its length: dots below are as well found by the first.
constexpr int kSecondThreshold = 3;
constexpr double kSecondDiameterPx = 8.0;
/// What a fit may need beyond its start's ellipse.
constexpr double kMoreReachPx = 1.5;
/// What the local Canny may look at beyond an ellipse.
constexpr double kUnclearReachPx = 10.0;

constexpr int kPlaces = 16;

const std::array<Eigen::Vector2d, kPlaces>& Directions() {
  static const auto directions = [] {
    std::array<Eigen::Vector2d, kPlaces> u;
    for (int i = 0; i < kPlaces; ++i) {
      const double t = 2 * std::numbers::pi * i / kPlaces;
      u[static_cast<std::size_t>(i)] = {std::cos(t), std::sin(t)};
    }
    return u;
  }();
  return directions;
}

/// Grey values at some distance from the ellipse, in the directions of its normals.
using Around = std::array<float, kPlaces>;

/// @return false if the window ends before.
bool SampleAround(const GreyWindow& window, const EllipseFrame& frame, double distance_px,
                  Around* grey) {
  const Eigen::Matrix2d& e = frame.shape;
  Around x, y;
  for (std::size_t k = 0; k < kPlaces; ++k) {
    const Eigen::Vector2d& u = Directions()[k];
    Eigen::Vector2d normal(e(1, 1) * u.x() - e(0, 1) * u.y(), e(0, 0) * u.y() - e(0, 1) * u.x());
    const Eigen::Vector2d p = frame.center + e * u + distance_px / normal.norm() * normal;
    if (!window.Covers(p.x(), p.y())) return false;
    x[k] = static_cast<float>(p.x());
    y[k] = static_cast<float>(p.y());
  }
  window.Sample(x.data(), y.data(), kPlaces, grey->data());
  return true;
}

float Median(Around grey) {
  std::nth_element(grey.begin(), grey.begin() + kPlaces / 2, grey.end());
  return grey[kPlaces / 2];
}

/// Grey values of a dot and its surroundings, whatever level it was cut out at.
/// @return false unless it is brighter inside than outside all around; one place may fail.
bool MeasureGrey(const GreyWindow& window, DotStart* dot) {
  constexpr int kMayFail = 1;
  constexpr double kNearPx = 1.25, kFarPx = 2.25;
  const Eigen::Matrix2d& e = dot->frame.shape;
  // (not less than the minor axis)
  const double minor = e.determinant() / std::max(e(0, 0), e(1, 1));
  Around deep, in, out, far;
  if (!SampleAround(window, dot->frame, kFarPx, &far) ||
      !SampleAround(window, dot->frame, kNearPx, &out) ||
      !SampleAround(window, dot->frame, -std::min(1.5, 0.6 * minor), &in) ||
      !SampleAround(window, dot->frame, -0.6 * minor, &deep)) {
    return false;
  }
  dot->inside = Median(deep);
  // On a narrow dark rim the nearer one is the dot's ground.
  dot->outside = std::min(Median(out), Median(far));
  const auto least = static_cast<float>(0.25 * (dot->inside - dot->outside));
  if (!(least > 0.0f)) return false;
  int failed = 0;
  for (std::size_t k = 0; k < kPlaces; ++k) failed += in[k] - out[k] < least;
  return failed <= kMayFail;
}

/// The ellipse cut at half height: of a blurred edge the part a is reached s times the
/// normal distribution's quantile of a inside of it, or 0.59 s ln(a / (1 - a)).
void Resize(double level, double blur_px, DotStart* dot) {
  const double part = std::clamp((level - dot->outside) / (dot->inside - dot->outside), 0.05, 0.95);
  const double inward = 0.59 * blur_px * std::log(part / (1.0 - part));
  Eigen::Matrix2d& e = dot->frame.shape;
  const double least = 0.5 * std::sqrt(std::max(0.0, e.determinant()));
  if (e(0, 0) + inward < least || e(1, 1) + inward < least) return;
  e(0, 0) += inward;
  e(1, 1) += inward;
}

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

/// Part of the residuals that is not noise, in units of the contrast.
double Misfit(const ModelFit& fit, const GreyNoise& noise, double pixels) {
  const double chance = 3.0 * std::sqrt(2.0 / pixels);
  const double excess = std::max(0.0, fit.variance_factor - 1.0 - chance);
  const double variance = excess * noise.Variance(0.5 * (fit.inside + fit.outside));
  return std::sqrt(variance) / (fit.inside - fit.outside);
}

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
  fits.clear();
  for (const Lesson& lesson : lessons) {
    const GreyWindow window = WindowOf(lesson.start->dot.frame, more);
    const auto fit = fitter_.Fit(window, lesson.start->dot, &*picture, true);
    if (fit) fits.push_back(*fit);
  }
  picture->gradient = PoolGradient(fits);
  return picture;
}

bool EdgePairRecognition::HasSize(const Ellipse& e) const {
  return 2.0 * e.semi_minor_px >= options_.diameter_px[0] &&
         2.0 * e.semi_major_px <= options_.diameter_px[1];
}

/// What is neither clearly a dot nor clearly none goes to unclear_.
std::optional<TargetEdge> EdgePairRecognition::MeasureByModel(const Start& start) {
  const bool by_model = picture_ && options_.estimator != Estimator::kMeanGradient;
  std::optional<ModelFit> fit;
  if (by_model) {
    const double reach = DotFitter::Reach(picture_->blur_px) + kMoreReachPx;
    fit = fitter_.Fit(WindowOf(start.dot.frame, reach), start.dot, &*picture_);
  }
  const double misfit = fit ? Misfit(*fit, picture_->noise, fit->pixels) : 0.0;
  if (!fit || misfit > kDot) {
    unclear_.push_back(start);
    return std::nullopt;
  }
  if (!HasSize(fit->ellipse)) return std::nullopt;
  return EdgeOf(*fit, picture_->noise);
}

std::optional<TargetEdge> EdgePairRecognition::MeasureByLocalCanny(const DotStart& dot) {
  const GreyWindow window = WindowOf(dot.frame, kUnclearReachPx);
  // The local Canny reads samples: of the window alone, so that every depth's are the same.
  std::vector<std::uint16_t> samples;
  samples.reserve(static_cast<std::size_t>(window.width) * static_cast<std::size_t>(window.height));
  const auto sign = static_cast<float>(reader_.sign());
  for (int y = window.y0; y < window.y0 + window.height; ++y) {
    for (int x = window.x0; x < window.x0 + window.width; ++x) {
      samples.push_back(static_cast<std::uint16_t>(sign * window(x, y)));
    }
  }
  const SignedImage<std::uint16_t> local(ImageView16(samples.data(), window.width, window.height),
                                         reader_.sign());
  Candidate candidate;
  candidate.ellipse = dot.frame.ToEllipse();
  candidate.ellipse.x_px -= window.x0;
  candidate.ellipse.y_px -= window.y0;
  candidate.inside = static_cast<float>(dot.inside);
  candidate.level = static_cast<float>(0.5 * (dot.inside + dot.outside));
  auto edge = MeasureTargetEdge(local, candidate, options_);
  if (!edge) return std::nullopt;
  const bool by_model = options_.estimator == Estimator::kModel;
  const auto fit =
      by_model ? FitModel(local, *edge, picture_ ? &*picture_ : nullptr) : std::nullopt;
  if (fit && !HasLeft(edge->ellipse, fit->ellipse)) {
    edge->ellipse = fit->ellipse;
    edge->cov = fit->cov;
    edge->inside = fit->inside;
    edge->outside = fit->outside;
  }
  edge->ellipse.x_px += window.x0;
  edge->ellipse.y_px += window.y0;
  return edge;
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
    auto edge = MeasureByLocalCanny(start.dot);
    // What lies beyond a narrow rim, or shines on the dot, draws the moments aside.
    if (!edge) edge = MeasureByLocalCanny(start.cut_out);
    if (edge) dots.push_back({*edge, start.region});
  }
  return dots;
}

}  // namespace videogrammetry
