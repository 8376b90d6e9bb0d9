#include "videogrammetry/recognition/dot_fit.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace videogrammetry {
namespace {

using dot_fit::kBlur, dot_fit::kExx, dot_fit::kExy, dot_fit::kEyy, dot_fit::kIn, dot_fit::kOut,
    dot_fit::kLightX, dot_fit::kLightY, dot_fit::kX, dot_fit::kY, dot_fit::kNumParameters;
using Parameters = Eigen::Matrix<double, kNumParameters, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;

/// The window: widths of the edge and pixels of plateau beyond on either side.
constexpr double kEdgeReach = 3.0, kPlateauPx = 1.5;
/// How far before a ring of code its edge is felt, and the least window outside, in widths.
constexpr double kRingReach = 2.5, kLeastOutside = 2.0;
constexpr int kIterations = 12;
/// A step this short is the last. With the first step's derivatives kept, each step
/// is about a twentieth of the one before.
constexpr double kConvergedPx = 0.01;
/// A first step this short leaves 0.3 e^2 / blur: 0.0002 px, and there is no need for
/// another where the residuals are noise, of up to this times the expected variance.
constexpr double kNearPx = 0.02, kUsualFactor = 1.5;
/// A first step this long, and one that is so large a part of the one before, asks
/// for new derivatives.
constexpr double kFarPx = 0.25, kSlow = 0.3;
constexpr double kHuber = 4.0, kStartOff = 0.2;
constexpr double kLeastBlurPx = 0.3, kMostBlurPx = 3.0;
/// Without a picture's model: how well the usual blur is known.
constexpr double kUsualBlurSigmaPx = 0.5;
/// And the noise, as a part of the contrast.
constexpr double kUsualNoise = 0.02;
/// A fit that leaves the start by more than this, and by this part of the dot, has
/// found something else.
constexpr double kMostMovedPx = 0.5, kMostMoved = 0.1;
/// And so has one with less than this part of its contrast.
constexpr double kLeastContrast = 0.2;

/// An ellipse's semi axes and E = mean I + half U, U symmetric, traceless, U^2 = I.
struct Axes {
  explicit Axes(const Eigen::Matrix2d& shape)
      : mean(0.5 * (shape(0, 0) + shape(1, 1))),
        xx(0.5 * (shape(0, 0) - shape(1, 1))),
        xy(shape(0, 1)),
        half(std::sqrt(xx * xx + xy * xy)) {}

  double major() const { return mean + half; }
  double minor() const { return mean - half; }
  /// The inside of the ellipse with the same directions and other semi axes.
  dot_fit::Conic ConicOf(double cx, double cy, double a, double b) const {
    const double ia = 1.0 / (a * a), ib = 1.0 / (b * b);
    const double even = 0.5 * (ia + ib), odd = half > 1e-9 ? 0.5 * (ia - ib) / half : 0.0;
    return {static_cast<float>(cx), static_cast<float>(cy), static_cast<float>(even + odd * xx),
            static_cast<float>(odd * xy), static_cast<float>(even - odd * xx)};
  }

  double mean, xx, xy, half;
};

const dot_fit::Kernels& KernelsOf([[maybe_unused]] InstructionSet set) {
#ifdef VIDEOGRAMMETRY_X86_KERNELS
  if (set == InstructionSet::kAvx512) return dot_fit::Avx512Kernels();
  if (set == InstructionSet::kAvx2) return dot_fit::Avx2Kernels();
#endif
  return dot_fit::BaselineKernels();
}

/// Normal equations N x = b by Cholesky's N = L D L^T, written out for the few unknowns
/// that there are: the library's takes four times as long. What is known is taken out of
/// all that is left at once, so that no step waits for a sum.
class NormalEquations {
 public:
  double matrix[kNumParameters][kNumParameters];  ///< upper triangle; D L^T after Factor
  double right[kNumParameters];

  bool Factor() {
    for (int j = 0; j < kNumParameters; ++j) {
      if (!(matrix[j][j] > 0.0)) return false;
      inverse_[j] = 1.0 / matrix[j][j];
      for (int i = j + 1; i < kNumParameters; ++i) {
        const double factor = matrix[j][i] * inverse_[j];
        for (int k = i; k < kNumParameters; ++k) matrix[i][k] -= factor * matrix[j][k];
      }
    }
    return true;
  }

  Parameters Solve(const double* b) const {
    Parameters x;
    for (int i = 0; i < kNumParameters; ++i) x[i] = b[i];
    for (int j = 0; j < kNumParameters; ++j) {
      x[j] *= inverse_[j];
      for (int i = j + 1; i < kNumParameters; ++i) x[i] -= matrix[j][i] * x[j];
    }
    for (int j = kNumParameters - 1; j > 0; --j) {
      for (int i = 0; i < j; ++i) x[i] -= matrix[i][j] * inverse_[i] * x[j];
    }
    return x;
  }

  /// Inverse of the last five rows and columns of L sqrt(D): N with the other unknowns
  /// eliminated is the product of that block and its transpose.
  Matrix5d InverseOfLast() const {
    constexpr int kFirst = kNumParameters - 5;
    Matrix5d out = Matrix5d::Identity();
    for (int j = 0; j < 5; ++j) {
      for (int k = j; k < 5; ++k) {
        const double known = out(k, j) * inverse_[kFirst + k];
        for (int i = k + 1; i < 5; ++i) out(i, j) -= matrix[kFirst + k][kFirst + i] * known;
      }
    }
    for (int i = 0; i < 5; ++i) out.row(i) *= std::sqrt(inverse_[kFirst + i]);
    return out;
  }

 private:
  double inverse_[kNumParameters];  ///< of D
};

/// A window's pixels that a fit looks at; coordinates are the window's less `origin`.
struct Selection {
  dot_fit::Pixels pixels = {};
  Eigen::Vector2d origin = Eigen::Vector2d::Zero();  ///< in the picture
};

/// @param whole  the dot's middle too, however far from the edge.
Selection SelectPixels(const dot_fit::Kernels& kernels, const GreyWindow& window,
                       const EllipseFrame& frame, double blur, bool whole,
                       std::vector<float>* buffer) {
  const Axes axes(frame.shape);
  const double reach = DotFitter::Reach(blur);
  // A ring begins a radius away, at the earliest.
  const auto outward = [&](double axis) {
    return axis + std::min(reach, std::max(kLeastOutside * blur, axis - kRingReach * blur));
  };
  const double cx = frame.center.x() - window.x0, cy = frame.center.y() - window.y0;
  const dot_fit::Conic outer = axes.ConicOf(cx, cy, outward(axes.major()), outward(axes.minor()));
  const bool hollow = !whole && axes.minor() > reach + 1.0;
  const dot_fit::Conic inner =
      hollow ? axes.ConicOf(cx, cy, axes.major() - reach, axes.minor() - reach) : dot_fit::Conic{};
  const std::size_t capacity =
      static_cast<std::size_t>(window.width) * static_cast<std::size_t>(window.height) +
      2 * dot_fit::kGroup;
  if (buffer->size() < 3 * capacity) buffer->resize(3 * capacity);
  float* x = buffer->data();
  const double left = std::round(cx), top = std::round(cy);
  const int count = kernels.select(window.data, window.stride, window.width, window.height, outer,
                                   hollow ? &inner : nullptr, static_cast<float>(left),
                                   static_cast<float>(top), x, x + capacity, x + 2 * capacity);
  return {{x, x + capacity, x + 2 * capacity, count}, {left + window.x0, top + window.y0}};
}

/// Gauss-Newton on the ten unknowns.
class Iteration {
 public:
  Iteration(const dot_fit::Kernels& kernels, const Selection& selection, const DotStart& start,
            const PictureModel* picture, bool pool, std::vector<float>* rows);

  /// @return false if it fails.
  bool Run();
  std::optional<ModelFit> Result(const DotStart& start) const;

 private:
  bool Step(bool linearise);
  void Sum(bool linearise);
  void FillPool(double contrast, double factor, ModelFit* fit) const;
  int count() const { return selection_.pixels.count; }
  double dof() const { return std::max(1.0, count() - 8.0); }

  const dot_fit::Kernels& kernels_;
  const Selection& selection_;
  const PictureModel* picture_;
  std::vector<float>& rows_;
  EllipseFrame frame_;                      ///< less the selection's origin
  Parameters values_ = Parameters::Zero();  ///< the last five unused: frame_
  dot_fit::State state_ = {};
  dot_fit::Sums sums_;
  double light_sigma_, blur_sigma_, blur_;  ///< priors
  double bright_;                           ///< grey value of the brighter side
  double contrast_;
  double prior_scale_;   ///< variance that the residuals are in units of
  double factor_ = 0.0;  ///< weighted square sum after the last step over its degrees of freedom
  double plain_factor_ = 0.0;  ///< the same, outliers at full weight
  double length_px_ = 0.0;     ///< of the last step
  NormalEquations equations_;
};

Iteration::Iteration(const dot_fit::Kernels& kernels, const Selection& selection,
                     const DotStart& start, const PictureModel* picture, bool pool,
                     std::vector<float>* rows)
    : kernels_(kernels),
      selection_(selection),
      picture_(picture),
      rows_(*rows),
      frame_(start.frame),
      contrast_(start.inside - start.outside) {
  rows_.resize(std::max(
      rows_.size(), static_cast<std::size_t>(count() + dot_fit::kGroup) * (kNumParameters + 2)));
  frame_.center -= selection.origin;
  const Eigen::Matrix2d light = frame_.shape.inverse();
  blur_ = picture ? picture->blur_px : DotFitter::kUsualBlurPx;
  blur_sigma_ = picture ? std::max(1e-4, picture->blur_sigma_px) : kUsualBlurSigmaPx;
  bright_ = std::max(std::abs(start.inside), std::abs(start.outside));
  light_sigma_ = (picture ? *picture : PictureModel{}).gradient * contrast_ / bright_;
  values_[kIn] = start.inside;
  values_[kOut] = start.outside;
  values_[kBlur] = blur_;
  state_.light = {static_cast<float>(frame_.center.x()), static_cast<float>(frame_.center.y()),
                  static_cast<float>(light(0, 0)), static_cast<float>(light(0, 1)),
                  static_cast<float>(light(1, 1))};
  const GreyNoise noise = picture ? picture->noise : GreyNoise{1.0, 0.0, 1.0};
  state_.noise_at_zero = static_cast<float>(noise.at_zero);
  state_.noise_per_grey = static_cast<float>(noise.per_grey);
  state_.noise_least = static_cast<float>(noise.least);
  state_.plateaus = pool;
  prior_scale_ = picture ? 1.0 : kUsualNoise * kUsualNoise * contrast_ * contrast_;
}

void Iteration::Sum(bool linearise) {
  values_[kExx] = frame_.shape(0, 0);
  values_[kExy] = frame_.shape(0, 1);
  values_[kEyy] = frame_.shape(1, 1);
  values_.tail<2>() = frame_.center;
  for (int i = 0; i < kNumParameters; ++i) state_.value[i] = static_cast<float>(values_[i]);
  const double light = prior_scale_ / (light_sigma_ * light_sigma_);
  const double blur = prior_scale_ / (blur_sigma_ * blur_sigma_);
  if (linearise) {
    kernels_.linearise(selection_.pixels, state_, rows_.data(), &sums_);
    int at = 0;
    for (int i = 0; i < kNumParameters; ++i) {
      for (int j = i; j < kNumParameters; ++j) {
        equations_.matrix[i][j] = static_cast<double>(sums_.product[at++]);
      }
    }
    for (const int k : {kLightX, kLightY}) equations_.matrix[k][k] += light;
    equations_.matrix[kBlur][kBlur] += blur;
  } else {
    kernels_.revise(selection_.pixels, state_, rows_.data(), &sums_);
  }
  for (int i = 0; i < kNumParameters; ++i) {
    equations_.right[i] = static_cast<double>(sums_.right[i]);
  }
  for (const int k : {kLightX, kLightY}) equations_.right[k] -= light * values_[k];
  equations_.right[kBlur] -= blur * (values_[kBlur] - blur_);
}

bool Iteration::Step(bool linearise) {
  Sum(linearise);
  if (linearise && !equations_.Factor()) return false;
  const Parameters step = equations_.Solve(equations_.right);
  Eigen::Matrix<double, 5, 1> moving;
  moving << step[kX], step[kY], step[kExx], step[kExy], step[kEyy];
  length_px_ = moving.norm();
  if (!(length_px_ < 1.5)) return false;  // NaN too
  const auto moved = frame_.Moved(moving);
  if (!moved) return false;
  frame_ = *moved;
  values_.head<5>() += step.head<5>();
  double fallen = 0.0;
  for (int i = 0; i < kNumParameters; ++i) fallen += step[i] * equations_.right[i];
  factor_ = std::max(1e-12, (sums_.squares - fallen) / dof());
  plain_factor_ = std::max(factor_, (sums_.plain_squares - fallen) / dof());
  return values_[kBlur] > kLeastBlurPx && values_[kBlur] < kMostBlurPx;
}

bool Iteration::Run() {
  if (count() < 2 * kNumParameters || !(contrast_ > 0.0)) return false;
  // What the start is aside by is no outlier: with a model what exceeds a fifth of the
  // contrast is one before the first step, without one nothing.
  double scale = 1e3;
  if (picture_) {
    const double sigma = std::sqrt(picture_->noise.Variance(0.5 * (values_[kIn] + values_[kOut])));
    scale = std::max(1.0, kStartOff * contrast_ / (kHuber * sigma));
  }
  bool linearise = true;
  double before = 1.0;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    state_.huber = static_cast<float>(kHuber * scale);
    if (!Step(linearise)) return false;
    const bool near = picture_ && factor_ < kUsualFactor && length_px_ < kNearPx;
    if (near || (length_px_ < kConvergedPx && iteration > 0)) return true;
    scale = std::sqrt(picture_ ? std::max(1.0, factor_) : factor_);
    // The equations' priors are in units of the variance.
    if (!picture_) prior_scale_ = factor_;
    linearise = !picture_ || (linearise ? length_px_ > kFarPx : length_px_ > kSlow * before);
    before = length_px_;
  }
  return false;
}

std::optional<ModelFit> Iteration::Result(const DotStart& start) const {
  ModelFit fit;
  EllipseFrame frame = frame_;
  frame.center += selection_.origin;
  fit.ellipse = frame.ToEllipse();
  const double most = kMostMovedPx + kMostMoved * fit.ellipse.semi_minor_px;
  const double contrast = values_[kIn] - values_[kOut];
  if ((frame.center - start.frame.center).norm() > most) return std::nullopt;
  if (!(contrast > kLeastContrast * contrast_)) return std::nullopt;
  fit.inside = values_[kIn];
  fit.outside = values_[kOut];
  fit.blur_px = values_[kBlur];
  fit.variance_factor = factor_;
  fit.plain_factor = plain_factor_;
  fit.pixels = count();
  const bool significant = factor_ > 1.0 + 2.5 * std::sqrt(2.0 / dof());
  const double factor = !picture_ || significant ? factor_ : 1.0;
  const Matrix5d half = equations_.InverseOfLast();  // of E, then of c
  Matrix5d jacobian;
  const Matrix5d by_frame = frame.EllipseJacobian();
  jacobian << by_frame.rightCols<3>(), by_frame.leftCols<2>();
  const Matrix5d part = half * jacobian.transpose();
  const Matrix5d cov = factor * part.transpose() * part;
  fit.cov = 0.5 * (cov + cov.transpose());  // rounding
  BoundDirection(&fit.cov);
  if (state_.plateaus) FillPool(contrast, factor, &fit);
  return fit;
}

/// The median over dots of chi^2 with k degrees of freedom is k (1 - 2 / (9 k))^3
/// (Wilson and Hilferty).
double MedianFree(double squares, double dof) {
  return squares / (dof * std::pow(1.0 - 2.0 / (9.0 * dof), 3));
}

void Iteration::FillPool(double contrast, double factor, ModelFit* fit) const {
  const auto variance = [&](int k) {
    double unit[kNumParameters] = {};
    unit[k] = 1.0;
    return equations_.Solve(unit)[k];
  };
  fit->blur_sigma_px = std::sqrt(factor * variance(kBlur));
  // Of the residuals before the last step, a short one.
  constexpr float kLeast = 6.0f;
  if (sums_.bright_count >= kLeast) {
    fit->inside_variance = MedianFree(sums_.bright_squares, sums_.bright_count - 2.0);
  }
  if (sums_.dark_count >= kLeast) {
    fit->outside_variance = MedianFree(sums_.dark_squares, sums_.dark_count - 2.0);
  }
  fit->variance = MedianFree(factor_ * dof(), dof());
  // The prior's part taken out: mean = t * (of the pixels alone), variance likewise.
  const double var = 0.5 * prior_scale_ * (variance(kLightX) + variance(kLightY));
  const double trust = std::max(0.02, 1.0 - var / (light_sigma_ * light_sigma_));
  const double to_contrast = bright_ / contrast;
  fit->gradient = values_.segment<2>(kLightX) * (to_contrast / trust);
  fit->gradient_variance = var * to_contrast * to_contrast / trust;
}

}  // namespace

DotFitter::DotFitter(InstructionSet set) : kernels_(&KernelsOf(set)) {}

double DotFitter::Reach(double blur_px) { return kEdgeReach * blur_px + kPlateauPx; }

std::optional<Eigen::Matrix2d> ShapeOfMoments(double xx, double xy, double yy) {
  // sqrt(V) = (V + sqrt(det V) I) / sqrt(tr V + 2 sqrt(det V))
  const double det = xx * yy - xy * xy;
  if (!(det > 1e-6) || !(xx > 0.0)) return std::nullopt;
  const double root = std::sqrt(det), scale = 2.0 / std::sqrt(xx + yy + 2.0 * root);
  Eigen::Matrix2d shape;
  shape << scale * (xx + root), scale * xy, scale * xy, scale * (yy + root);
  return shape;
}

std::optional<DotStart> DotFitter::Begin(const GreyWindow& window, const DotStart& start,
                                         double blur_px) {
  if (!(start.inside > start.outside)) return std::nullopt;
  const Selection selection = SelectPixels(*kernels_, window, start.frame, blur_px, true, &pixels_);
  float sums[6];
  kernels_->moments(selection.pixels, static_cast<float>(start.inside),
                    static_cast<float>(start.outside), sums);
  const double area = sums[0];
  if (!(area > 1.0)) return std::nullopt;
  const Eigen::Vector2d mean(sums[1] / area, sums[2] / area);
  const double blur = blur_px * blur_px;
  const auto shape = ShapeOfMoments(sums[3] / area - mean.x() * mean.x() - blur,
                                    sums[4] / area - mean.x() * mean.y(),
                                    sums[5] / area - mean.y() * mean.y() - blur);
  if (!shape) return std::nullopt;
  DotStart moved = start;
  moved.frame.center = mean + selection.origin;
  moved.frame.shape = *shape;
  const double most = kMostMovedPx + kMostMoved * std::sqrt(start.frame.shape.determinant());
  if ((moved.frame.center - start.frame.center).norm() > 2.0 * most) return std::nullopt;
  return moved;
}

std::optional<ModelFit> DotFitter::Fit(const GreyWindow& window, const DotStart& start,
                                       const PictureModel* picture, bool pool) {
  const double blur = picture ? picture->blur_px : DotFitter::kUsualBlurPx;
  const Selection selection = SelectPixels(*kernels_, window, start.frame, blur, false, &pixels_);
  Iteration iteration(*kernels_, selection, start, picture, pool, &rows_);
  if (!iteration.Run()) return std::nullopt;
  return iteration.Result(start);
}

}  // namespace videogrammetry
