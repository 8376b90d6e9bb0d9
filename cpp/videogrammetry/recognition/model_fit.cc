#include "videogrammetry/recognition/model_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "videogrammetry/core/median.h"
#include "videogrammetry/recognition/ellipse_fit.h"

namespace videogrammetry {
namespace {

// Parameters: the ellipse's five, m1, g1 (2), m2, g2 (2), s.
constexpr int kInside = 5, kOutside = 8, kBlur = 11, kNumParameters = 12;
using Parameters = Eigen::Matrix<double, kNumParameters, 1>;
using Normal = Eigen::Matrix<double, kNumParameters, kNumParameters>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;

/// The part of glare that is curved over the dot and so not described.
constexpr double kGlareCurve = 0.7;
/// The window: widths of the edge and pixels of plateau beyond on either side.
constexpr double kEdgeReach = 3.0, kPlateauPx = 1.5;
/// How far before a ring of code its edge is felt, and the least window outside, in widths.
constexpr double kRingReach = 2.5, kLeastOutside = 2.0;
constexpr int kIterations = 5;
/// A step this short leaves one of second order in it.
constexpr double kConvergedPx = 5e-3;
constexpr double kHuber = 4.0;
/// Share of the step in the grey values beyond which a pixel is of a plateau.
constexpr double kPlateau = 0.95;
constexpr int kLeastPlateauPixels = 6;
/// The ground ends where it is brighter by this part of the contrast: mean of the pixels
/// in a band of half a pixel around the dot.
constexpr double kGroundRise = 0.1, kBandPx = 0.5;
/// A fit that leaves the start by more than this has found something else.
constexpr double kMostMovedPx = 0.3, kMostResizedPx = 0.6;
constexpr double kLeastBlurPx = 0.3, kMostBlurPx = 3.0;

/// A step of Newton's towards the point of the ellipse nearest to c + q: on (q - E u) . E u' = 0
/// along the circle of u. @return its length, rad.
double StepToNearest(const EllipseFrame& frame, const Eigen::Vector2d& q, Eigen::Vector2d* u) {
  const Eigen::Vector2d across(-u->y(), u->x());
  const Eigen::Vector2d on = frame.shape * *u, gap = q - on, tangent = frame.shape * across;
  const double speed = tangent.squaredNorm();
  const double slope = std::max(0.2 * speed, speed + gap.dot(on));
  const double step = std::clamp(gap.dot(tangent) / slope, -0.5, 0.5);
  *u += step * across;
  *u *= 1.0 / u->norm();
  return std::abs(step);
}

/// The contour's point nearest to a pixel: u, the outward normal there and the distance inward.
struct Foot {
  Eigen::Vector2d u, normal;
  double distance = 0.0;

  /// @param inverse  E^-1.
  static Foot At(const EllipseFrame& frame, const Eigen::Matrix2d& inverse,
                 const Eigen::Vector2d& p) {
    const Eigen::Vector2d q = p - frame.center;
    Foot foot;
    foot.u = inverse * q;
    const double length = foot.u.norm();
    if (length < 1e-3) {
      foot.u = {1.0, 0.0};
    } else {
      foot.u /= length;
      for (int i = 0; i < 3; ++i) {
        if (StepToNearest(frame, q, &foot.u) < 1e-3) break;  // the next is of second order
      }
    }
    foot.Finish(frame, q);
    return foot;
  }

  /// The same once the contour has moved a little: what one step leaves is of second order.
  void Follow(const EllipseFrame& frame, const Eigen::Vector2d& p) {
    const Eigen::Vector2d q = p - frame.center;
    StepToNearest(frame, q, &u);
    Finish(frame, q);
  }

 private:
  void Finish(const EllipseFrame& frame, const Eigen::Vector2d& q) {
    normal = frame.Normal(u);
    distance = normal.dot(frame.shape * u - q);
  }
};

/// Value and derivatives of Eqs. (1) to (3) at one pixel.
struct Edge {
  double share = 0.0;  ///< F
  double by_distance = 0.0, by_blur = 0.0;
};

Edge EdgeAt(double distance, double curvature, double box_kurtosis, double s) {
  const double ks = curvature * s;
  const double shift = s * ks * (0.5 + 0.375 * ks * ks);
  const double width = s * std::sqrt(1.0 + 0.5 * ks * ks);
  const double z = (distance - shift) / width;
  const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
  const double cumulant = box_kurtosis / (24.0 * width * width * width * width);
  Edge edge;
  // Eq. (3): minus the fourth cumulant (negative) times He3(z) phi(z).
  edge.share = 0.5 * std::erfc(-z / std::numbers::sqrt2) + cumulant * z * (z * z - 3.0) * density;
  edge.by_distance = density / width;
  edge.by_blur = density * (-z / s - curvature);
  return edge;
}

struct Pixel {
  Eigen::Vector2d at, v;
  double grey = 0.0;
  double outward = 0.0;  ///< of the contour that the fit began with
  Foot foot;
};

/// The fit in its current state.
class Fit {
 public:
  template <typename T>
  Fit(const SignedImage<T>& image, const TargetEdge& start, const PictureModel* picture);

  bool Iterate();
  std::optional<ModelFit> Result() const;

 private:
  template <typename T>
  void CollectPixels(const SignedImage<T>& image);
  void EndGround();
  void SetPriors(const TargetEdge& start);
  void Linearise();
  void WeighAndSum();

  const PictureModel* picture_;
  EllipseFrame frame_;
  bool has_moved_ = false;  ///< since the pixels were collected
  Eigen::Matrix2d start_inverse_;
  Ellipse start_;
  Parameters values_ = Parameters::Zero();  ///< the first five unused: frame_
  double curved_ = 0.0;                     ///< glare that the model lacks, grey values
  int bright_ = kInside;                    ///< the brighter side
  double light_ = 1.0;                      ///< prior deviation of its gradient
  double prior_scale_ = 1.0;                ///< variance that residuals are in units of
  std::vector<Pixel> pixels_;
  Eigen::Matrix<double, Eigen::Dynamic, kNumParameters, Eigen::RowMajor> rows_;
  Eigen::VectorXd residuals_, share_, variance_, weight_;
  Normal prior_ = Normal::Zero();  ///< weights of the priors
  Parameters prior_mean_ = Parameters::Zero();
  Normal normal_ = Normal::Zero();
  Parameters right_ = Parameters::Zero();
};

template <typename T>
Fit::Fit(const SignedImage<T>& image, const TargetEdge& start, const PictureModel* picture)
    : picture_(picture), frame_(EllipseFrame::From(start.ellipse)), start_(start.ellipse) {
  start_inverse_ = frame_.shape.inverse();
  values_[kInside] = start.inside;
  values_[kOutside] = start.outside;
  // The profiles' spread holds 1/12 px^2 of the difference quotient.
  const double own = std::sqrt(std::max(0.16, start.width_px * start.width_px - 1.0 / 12.0));
  values_[kBlur] = std::min(picture ? picture->blur_px : own, kMostBlurPx);
  SetPriors(start);
  CollectPixels(image);
}

void Fit::SetPriors(const TargetEdge& start) {
  const double contrast = start.inside - start.outside;
  const double glare = std::max(start.inside_glare, start.outside_glare);
  curved_ = kGlareCurve * glare;
  const bool inside_brighter = std::abs(start.inside) >= std::abs(start.outside);
  const int bright = bright_ = inside_brighter ? kInside : kOutside;
  const int dark = inside_brighter ? kOutside : kInside;
  const double ratio =
      inside_brighter ? start.outside / start.inside : start.inside / start.outside;
  const PictureModel common = picture_ ? *picture_ : PictureModel{};
  const double light = light_ = std::hypot(common.gradient * contrast, glare);
  // of the darker side beyond its share of the light
  const double flare = std::hypot(common.flare * contrast, glare);
  for (int i = 1; i <= 2; ++i) {
    prior_(bright + i, bright + i) += 1.0 / (light * light);
    Parameters difference = Parameters::Zero();  // of the darker side from its share of the light
    difference[dark + i] = 1.0 / flare;
    difference[bright + i] = -ratio / flare;
    prior_ += difference * difference.transpose();
  }
  if (picture_) {
    const double sigma = std::max(1e-4, picture_->blur_sigma_px);
    prior_(kBlur, kBlur) = 1.0 / (sigma * sigma);
    prior_mean_[kBlur] = picture_->blur_px;
  }
}

template <typename T>
void Fit::CollectPixels(const SignedImage<T>& image) {
  const double s = values_[kBlur];
  const double reach = kEdgeReach * s + kPlateauPx;
  const double half_x = frame_.shape.row(0).norm() + reach;
  const double half_y = frame_.shape.row(1).norm() + reach;
  const int x0 = std::max(0, static_cast<int>(std::ceil(frame_.center.x() - half_x)));
  const int x1 = std::min(image.width() - 1, static_cast<int>(frame_.center.x() + half_x));
  const int y0 = std::max(0, static_cast<int>(std::ceil(frame_.center.y() - half_y)));
  const int y1 = std::min(image.height() - 1, static_cast<int>(frame_.center.y() + half_y));
  // Wholly inside: no pixel of the edge.
  const double deep = 1.0 - reach / std::max(reach, start_.semi_minor_px);
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const Eigen::Vector2d p(x, y), v = start_inverse_ * (p - frame_.center);
      const double radius = v.norm();
      // (a pixel is no nearer than along the minor axis)
      if (radius < deep || (radius - 1.0) * start_.semi_minor_px > reach) continue;
      const Foot foot = Foot::At(frame_, start_inverse_, p);
      const double outward = -foot.distance;
      // A ring begins at twice the radius: |E n| beyond the dot along n.
      const double free = (frame_.shape * foot.normal).norm() - kRingReach * s;
      const double most = std::min(reach, std::max(kLeastOutside * s, free));
      if (outward > most || (radius < 1.0 && -outward > reach)) continue;
      pixels_.push_back({p, v, static_cast<double>(image(x, y)), outward, foot});
    }
  }
  EndGround();
  const auto n = static_cast<Eigen::Index>(pixels_.size());
  rows_.resize(n, kNumParameters);
  residuals_.resize(n);
  share_.resize(n);
  variance_.resize(n);
  weight_.resize(n);
}

/// Leaves out what lies beyond a narrow ground: a rim around the dot on something
/// brighter, whose edge is felt as far before it as a ring's.
void Fit::EndGround() {
  const double s = values_[kBlur], first = kLeastOutside * s;
  constexpr std::size_t kBands = 32;
  std::array<double, kBands> sum = {}, count = {};
  for (const Pixel& pixel : pixels_) {
    const double band = std::floor((pixel.outward - first) / kBandPx) + 1.0;
    if (band < 0.0 || band >= static_cast<double>(kBands)) continue;
    sum[static_cast<std::size_t>(band)] += pixel.grey;
    count[static_cast<std::size_t>(band)] += 1.0;
  }
  const double rise = kGroundRise * (values_[kInside] - values_[kOutside]);
  double darkest = 1e300;
  for (std::size_t band = 0; band < kBands && count[band] > 0.0; ++band) {
    const double mean = sum[band] / count[band];
    darkest = std::min(darkest, mean);
    if (mean < darkest + rise) continue;
    // The rise is half-way no nearer than here, and felt before it.
    const double end = first + (static_cast<double>(band) - 0.5) * kBandPx;
    const double most = std::max(first, end - s);
    std::erase_if(pixels_, [&](const Pixel& pixel) { return pixel.outward > most; });
    return;
  }
}

void Fit::Linearise() {
  const double area = frame_.shape.determinant(), s = values_[kBlur];
  for (std::size_t k = 0; k < pixels_.size(); ++k) {
    Pixel& pixel = pixels_[k];
    if (has_moved_) pixel.foot.Follow(frame_, pixel.at);
    const Foot& foot = pixel.foot;
    const Eigen::Vector2d &u = foot.u, &n = foot.normal;
    const double speed = (frame_.shape * Eigen::Vector2d(-u.y(), u.x())).norm();
    const double curvature = area / (speed * speed * speed);
    const double xx = n.x() * n.x(), yy = n.y() * n.y();
    const Edge edge = EdgeAt(foot.distance, curvature, (xx * xx + yy * yy) / 120.0, s);
    const Eigen::Vector3d ground(1.0, pixel.v.x(), pixel.v.y());
    const double in = ground.dot(values_.segment<3>(kInside));
    const double out = ground.dot(values_.segment<3>(kOutside));
    const auto i = static_cast<Eigen::Index>(k);
    const double along = (in - out) * edge.by_distance, ax = along * n.x(), ay = along * n.y();
    rows_.row(i) << ax, ay, ax * u.x(), ax * u.y() + ay * u.x(), ay * u.y(),
        edge.share * ground.transpose(), (1.0 - edge.share) * ground.transpose(),
        (in - out) * edge.by_blur;
    const double grey = out + (in - out) * edge.share;
    residuals_[i] = pixel.grey - grey;
    share_[i] = edge.share;
    variance_[i] = picture_ ? picture_->noise.Variance(grey) : 1.0;
  }
}

void Fit::WeighAndSum() {
  const auto n = static_cast<std::size_t>(residuals_.size());
  std::vector<double> sizes(n);
  for (std::size_t k = 0; k < n; ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    sizes[k] = std::abs(residuals_[i]) / std::sqrt(variance_[i]);
  }
  const double robust = 1.4826 * Median(sizes);
  const double limit = kHuber * std::max(robust, picture_ ? 1.0 : 1e-9);
  for (std::size_t k = 0; k < n; ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    weight_[i] = (sizes[k] > limit ? limit / sizes[k] : 1.0) / variance_[i];
  }
  // Without a noise model the residuals say what the priors weigh against.
  prior_scale_ = picture_ ? 1.0 : std::max(1.0 / 12.0, robust * robust);
  const Normal prior = prior_scale_ * prior_;
  normal_ = prior;
  right_ = prior * (prior_mean_ - values_);
  for (Eigen::Index i = 0; i < rows_.rows(); ++i) {
    const Parameters row = rows_.row(i), weighted = weight_[i] * row;
    for (int k = 0; k < kNumParameters; ++k) normal_.col(k) += weighted[k] * row;
    right_ += residuals_[i] * weighted;
  }
}

bool Fit::Iterate() {
  if (pixels_.size() < 2 * kNumParameters) return false;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Linearise();
    WeighAndSum();
    const Eigen::LDLT<Normal> solver(normal_);
    if (solver.info() != Eigen::Success || !solver.isPositive()) return false;
    const Parameters step = solver.solve(right_);
    if (!step.allFinite() || step.head<5>().norm() > 1.5) return false;
    const auto moved = frame_.Moved(step.head<5>());
    if (!moved) return false;
    frame_ = *moved;
    has_moved_ = true;
    values_.tail<7>() += step.tail<7>();
    if (!(values_[kBlur] > kLeastBlurPx) || !(values_[kBlur] < kMostBlurPx)) return false;
    if (step.head<5>().norm() < kConvergedPx) {
      residuals_ -= rows_ * step;
      return true;
    }
  }
  return false;
}

/// Variance of the residuals that are `on`, if there are enough of them, such
/// that its median over dots is the noise's: that of chi^2 with k degrees of
/// freedom is k (1 - 2 / (9 k))^3 (Wilson and Hilferty).
std::optional<double> ResidualVariance(const Eigen::VectorXd& residuals,
                                       const std::vector<char>& on, int parameters) {
  std::vector<double> squares;
  for (std::size_t k = 0; k < on.size(); ++k) {
    const double r = residuals[static_cast<Eigen::Index>(k)];
    if (on[k]) squares.push_back(r * r);
  }
  if (squares.size() < kLeastPlateauPixels) return std::nullopt;
  double sum = 0;
  for (const double square : squares) sum += square;
  const double dof = static_cast<double>(static_cast<int>(squares.size()) - parameters);
  return sum / (dof * std::pow(1.0 - 2.0 / (9.0 * dof), 3));
}

std::optional<ModelFit> Fit::Result() const {
  ModelFit fit;
  fit.ellipse = frame_.ToEllipse();
  const double contrast = values_[kInside] - values_[kOutside];
  if (HasLeft(start_, fit.ellipse) || !(contrast > 0)) return std::nullopt;
  fit.inside = values_[kInside];
  fit.outside = values_[kOutside];
  fit.blur_px = values_[kBlur];
  std::vector<char> bright, dark;
  for (Eigen::Index i = 0; i < share_.size(); ++i) {
    bright.push_back(share_[i] > kPlateau);
    dark.push_back(share_[i] < 1.0 - kPlateau);
  }
  fit.inside_variance = ResidualVariance(residuals_, bright, 2);
  fit.outside_variance = ResidualVariance(residuals_, dark, 2);
  fit.variance = *ResidualVariance(residuals_, std::vector<char>(bright.size(), 1), 8);
  const double dof = std::max(1.0, static_cast<double>(residuals_.size()) - 8.0);
  fit.pixels = static_cast<int>(residuals_.size());
  fit.variance_factor = weight_.dot(residuals_.cwiseAbs2()) / dof;
  const bool significant = fit.variance_factor > 1.0 + 2.5 * std::sqrt(2.0 / dof);
  const double factor = !picture_ || significant ? fit.variance_factor : 1.0;
  const Normal inverse = normal_.ldlt().solve(Normal::Identity());
  fit.blur_sigma_px = std::sqrt(factor * inverse(kBlur, kBlur));
  const Matrix5d jacobian = frame_.EllipseJacobian();
  const Matrix5d cov = factor * jacobian * inverse.topLeftCorner<5, 5>() * jacobian.transpose();
  fit.cov = 0.5 * (cov + cov.transpose());
  if (curved_ == 0.0) {
    // The prior's part taken out: mean = t * (of the pixels alone), variance likewise.
    const double var = 0.5 * prior_scale_ *
                       (inverse(bright_ + 1, bright_ + 1) + inverse(bright_ + 2, bright_ + 2));
    const double trust = std::max(0.02, 1.0 - var / (light_ * light_));
    fit.gradient = values_.segment<2>(bright_ + 1) / (trust * contrast);
    fit.gradient_variance = var / (trust * contrast * contrast);
  }
  // A level wrong by g moves the half-way level by g / 2, its edge by g s / (2 phi(0) C).
  const double lever = 0.5 * curved_ * fit.blur_px * std::sqrt(2.0 * std::numbers::pi) / contrast;
  fit.cov(0, 0) += 2.0 * lever * lever;
  fit.cov(1, 1) += 2.0 * lever * lever;
  BoundDirection(&fit.cov);
  return fit;
}

}  // namespace

bool HasLeft(const Ellipse& start, const Ellipse& e) {
  const double moved = std::hypot(e.x_px - start.x_px, e.y_px - start.y_px);
  const double resized = std::max(std::abs(e.semi_major_px - start.semi_major_px),
                                  std::abs(e.semi_minor_px - start.semi_minor_px));
  return moved > kMostMovedPx || resized > kMostResizedPx;
}

template <typename T>
std::optional<ModelFit> FitModel(const SignedImage<T>& image, const TargetEdge& start,
                                 const PictureModel* picture) {
  Fit fit(image, start, picture);
  if (!fit.Iterate()) return std::nullopt;
  return fit.Result();
}

template std::optional<ModelFit> FitModel(const SignedImage<std::uint8_t>&, const TargetEdge&,
                                          const PictureModel*);
template std::optional<ModelFit> FitModel(const SignedImage<std::uint16_t>&, const TargetEdge&,
                                          const PictureModel*);

}  // namespace videogrammetry
