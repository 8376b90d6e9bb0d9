#include "videogrammetry/recognition/edge_pair_recognition.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>

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
/// model of a dot is right. Of real pictures' dots 97 % are below; nothing else is.
constexpr double kDot = 0.03;
/// What a fit may need beyond its start's ellipse.
constexpr double kMoreReachPx = 2.0;
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

/// Grey values at some distances from the ellipse, in the directions of its normals.
template <std::size_t kDistances>
using Around = std::array<std::array<float, kPlaces>, kDistances>;

/// @return false if the window ends before.
template <std::size_t kDistances>
bool SampleAround(const GreyWindow& window, const EllipseFrame& frame,
                  const std::array<double, kDistances>& distances_px, Around<kDistances>* grey) {
  const Eigen::Matrix2d& e = frame.shape;
  Around<kDistances> x, y;
  double left = 1e9, right = -1e9, top = 1e9, bottom = -1e9;
  for (std::size_t k = 0; k < kPlaces; ++k) {
    const double ux = Directions()[k].x(), uy = Directions()[k].y();
    const double nx = e(1, 1) * ux - e(0, 1) * uy, ny = e(0, 0) * uy - e(0, 1) * ux;
    const double length = 1.0 / std::sqrt(nx * nx + ny * ny);
    const double px = frame.center.x() + e(0, 0) * ux + e(0, 1) * uy;
    const double py = frame.center.y() + e(0, 1) * ux + e(1, 1) * uy;
    for (std::size_t i = 0; i < kDistances; ++i) {
      const double qx = px + distances_px[i] * length * nx;
      const double qy = py + distances_px[i] * length * ny;
      x[i][k] = static_cast<float>(qx);
      y[i][k] = static_cast<float>(qy);
      left = std::min(left, qx);
      right = std::max(right, qx);
      top = std::min(top, qy);
      bottom = std::max(bottom, qy);
    }
  }
  if (!window.Covers(left, top) || !window.Covers(right, bottom)) return false;
  window.Sample(x[0].data(), y[0].data(), static_cast<int>(kDistances * kPlaces),
                (*grey)[0].data());
  return true;
}

float Median(std::array<float, kPlaces> grey) {
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
  Around<4> grey;
  const std::array<double, 4> distances = {-0.6 * minor, -std::min(1.5, 0.6 * minor), kNearPx,
                                           kFarPx};
  if (!SampleAround(window, dot->frame, distances, &grey)) return false;
  const auto& [deep, in, out, far] = grey;
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

}  // namespace

EdgePairRecognition::EdgePairRecognition(const FrameView& frame, const RecognitionOptions& options,
                                         const CodeFamily& family)
    : options_(options),
      family_(family),
      reader_(frame, options.polarity == Polarity::kWhiteOnBlack ? 1 : -1),
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
  *window = WindowOf(dot.frame, DotFitter::Reach(blur_px) + kMoreReachPx);
  if (!MeasureGrey(*window, &dot)) return std::nullopt;
  Resize(region.level(), blur_px, &dot);
  const auto begun = fitter_.Begin(*window, dot, blur_px);
  return Start{begun ? *begun : dot, dot};
}

std::optional<PictureModel> EdgePairRecognition::Learn(const std::vector<DotRegion>& regions,
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
  // How even the light is shows with the noise known only.
  fits.clear();
  for (const Lesson& lesson : lessons) {
    window = WindowOf(lesson.start.frame, DotFitter::Reach(picture->blur_px) + kMoreReachPx);
    const auto fit = fitter_.Fit(window, lesson.start, &*picture, true);
    if (fit) fits.push_back(*fit);
  }
  picture->gradient = PoolGradient(fits);
  return picture;
}

bool EdgePairRecognition::HasSize(const Ellipse& e) const {
  return 2.0 * e.semi_minor_px >= options_.diameter_px[0] &&
         2.0 * e.semi_major_px <= options_.diameter_px[1];
}

/// What is not clearly a dot goes to unclear_.
std::optional<TargetEdge> EdgePairRecognition::MeasureByModel(const Start& start,
                                                              const GreyWindow& window) {
  std::optional<ModelFit> fit;
  if (picture_ && options_.estimator != Estimator::kMeanGradient) {
    fit = fitter_.Fit(window, start.dot, &*picture_);
  }
  if (!fit || Misfit(*fit, picture_->noise, fit->pixels) > kDot) {
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

void EdgePairRecognition::Add(const TargetEdge& edge) {
  const Ellipse& e = edge.ellipse;
  if (IsKnown(e, targets_, places_)) return;
  places_.Insert(e.x_px, e.y_px, static_cast<int>(targets_.size()));
  Target target{edge, {}};
  if (family_.num_bits > 0) {
    const GreyWindow window = ReadRingWindow(edge, family_, &reader_);
    target.ring = ReadRing(window, edge, family_, options_.direction);
    rings_.Add(target);
  }
  targets_.push_back(target);
}

bool EdgePairRecognition::IsMeasured(const EllipseFrame& frame) const {
  const double reach = 0.1 * std::sqrt(frame.shape.determinant());
  const double x = frame.center.x(), y = frame.center.y();
  return places_.AnyNear(x, y, reach, [](int) { return true; });
}

void EdgePairRecognition::MeasureUnclear() {
  for (const Start& start : unclear_) {
    const Ellipse e = start.dot.frame.ToEllipse();
    if (rings_.Holds(start.dot.frame.center, e.semi_minor_px)) continue;
    if (IsKnown(e, targets_, places_)) continue;
    auto edge = MeasureByLocalCanny(start.dot);
    // What lies beyond a narrow rim, or shines on the dot, draws the moments aside.
    if (!edge) edge = MeasureByLocalCanny(start.cut_out);
    if (edge) Add(*edge);
  }
}

std::vector<Target> EdgePairRecognition::Measure(const std::vector<DotRegion>& regions,
                                                 const CameraModel* camera) {
  const auto area = [&](int i) { return regions[static_cast<std::size_t>(i)].moments.area; };
  std::vector<int> order(regions.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return area(a) > area(b); });
  picture_ = camera ? std::optional(camera->picture) : Learn(regions, order);
  const double blur_px = picture_ ? picture_->blur_px : DotFitter::kUsualBlurPx;
  GreyWindow window;
  for (const int i : order) {
    const DotRegion& region = regions[static_cast<std::size_t>(i)];
    const ContourMoments& m = region.moments;
    const Eigen::Vector2d center(m.mean_x, m.mean_y);
    // (not less than the minor axis)
    const double minor =
        m.area / (2.0 * std::numbers::pi * std::sqrt(std::max(m.var_xx, m.var_yy)));
    if (rings_.Holds(center, minor)) continue;
    auto start = BeginAt(region, blur_px, &window);
    if (!start || IsMeasured(start->dot.frame)) continue;
    if (const auto edge = MeasureByModel(*start, window)) Add(*edge);
  }
  MeasureUnclear();
  std::sort(targets_.begin(), targets_.end(), [](const Target& a, const Target& b) {
    const Ellipse &e = a.edge.ellipse, &f = b.edge.ellipse;
    return e.y_px != f.y_px ? e.y_px < f.y_px : e.x_px < f.x_px;
  });
  return std::move(targets_);
}

}  // namespace videogrammetry
