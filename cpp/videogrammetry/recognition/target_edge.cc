#include "videogrammetry/recognition/target_edge.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "videogrammetry/core/median.h"
#include "videogrammetry/recognition/edge_points.h"
#include "videogrammetry/recognition/edge_profile.h"
#include "videogrammetry/recognition/ellipse_fit.h"
#include "videogrammetry/recognition/local_canny.h"

namespace videogrammetry {
namespace {

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;

/// Length of contour that holds one independent observation: profiles of white
/// pixel noise interpolated bilinearly are correlated over this distance.
constexpr double kCorrelationPx = 1.5;
/// A dot stands on one ground. Something that covers a part of it, or of its
/// sticker up to the dot's edge, makes the ground's first harmonic larger than
/// this, in units of the contrast.
constexpr double kMostUneven = 0.15;
constexpr double kBandPx = 2.5;
constexpr int kMaxIterations = 4;

/// A look at sixteen places before any work is done: a dot is brighter inside
/// than outside all around.
template <typename T>
bool HasContrastAllAround(const SignedImage<T>& image, const Candidate& candidate) {
  constexpr int kPlaces = 16, kMayFail = 1;
  const EllipseFrame frame = EllipseFrame::From(candidate.ellipse);
  const double inward = std::min(1.5, 0.6 * candidate.ellipse.semi_minor_px);
  const float least = 0.5f * (candidate.inside - candidate.level);
  int failed = 0;
  for (int i = 0; i < kPlaces; ++i) {
    const double t = 2 * std::numbers::pi * i / kPlaces;
    const Eigen::Vector2d u(std::cos(t), std::sin(t));
    const Eigen::Vector2f point = frame.Point(u).cast<float>();
    const Eigen::Vector2f normal = frame.Normal(u).cast<float>();
    const Eigen::Vector2f in = point - static_cast<float>(inward) * normal;
    const Eigen::Vector2f out = point + 1.25f * normal;
    failed += image.Bilinear(in.x(), in.y()) - image.Bilinear(out.x(), out.y()) < least;
  }
  return failed <= kMayFail;
}

/// Largest gap between the points' directions from the centre, on the circle
/// that the ellipse is the picture of, as a length along a circle of the
/// ellipse's mean radius.
double LargestGapPx(const Ellipse& e, const Points2d& points, const Eigen::ArrayXi& inliers) {
  const double c = std::cos(e.angle_rad), s = std::sin(e.angle_rad);
  std::vector<double> angles;
  for (Eigen::Index i = 0; i < points.rows(); ++i) {
    if (inliers[i] == 0) continue;
    const double dx = points(i, 0) - e.x_px, dy = points(i, 1) - e.y_px;
    angles.push_back(
        std::atan2((-s * dx + c * dy) / e.semi_minor_px, (c * dx + s * dy) / e.semi_major_px));
  }
  if (angles.size() < 3) return 1e9;
  std::sort(angles.begin(), angles.end());
  double gap = angles.front() + 2 * std::numbers::pi - angles.back();
  for (std::size_t i = 1; i < angles.size(); ++i) gap = std::max(gap, angles[i] - angles[i - 1]);
  return gap * 0.5 * (e.semi_major_px + e.semi_minor_px);
}

/// Steps 3 to 5 of the local Canny as the paper has them.
template <typename T>
std::optional<Ellipse> EllipseFromCanny(const SignedImage<T>& image, const Ellipse& start) {
  const auto edges = LocalCanny(image, start, kBandPx);
  const Points2d points = MeanGradientPoints(image, edges);
  if (points.rows() < 8) return std::nullopt;
  Eigen::ArrayXi inliers;
  const auto ellipse = FitEllipseRobust(points, &inliers);
  if (!ellipse || inliers.sum() < 0.7 * static_cast<double>(points.rows())) return std::nullopt;
  const double allowed = std::max(3.5, 0.12 * 2 * std::numbers::pi * ellipse->semi_minor_px);
  if (LargestGapPx(*ellipse, points, inliers) > allowed) return std::nullopt;
  return ellipse;
}

/// The orthogonal-distance fit in its current state.
struct Refinement {
  EllipseFrame frame;
  EdgeProfiles profiles;
  EdgeLevels levels;
  Eigen::ArrayXd residuals;  ///< of every profile, after the last step
  double shift_variance_px2 = 0.0, size_variance_px2 = 0.0;
  std::vector<char> used;
  Matrix5d normal = Matrix5d::Zero();  ///< J^T W J
};

void SelectProfiles(Refinement* r) {
  const auto n = static_cast<std::size_t>(r->profiles.count());
  std::vector<double> sizes(n);
  const double middle = Median({r->residuals.begin(), r->residuals.end()});
  for (std::size_t i = 0; i < n; ++i) {
    sizes[i] = std::abs(r->residuals[static_cast<Eigen::Index>(i)] - middle);
  }
  const double limit = std::max(0.25, 3.5 * 1.4826 * Median(sizes));
  for (std::size_t i = 0; i < n; ++i) r->used[i] = sizes[i] <= limit;
}

/// One Gauss-Newton step; returns its length in pixels or nullopt.
std::optional<double> Step(Refinement* r) {
  const int n = r->profiles.count();
  r->normal.setZero();
  Vector5d right = Vector5d::Zero();
  std::vector<Eigen::Matrix<double, 1, 5>> rows(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    rows[k] = r->frame.NormalJacobian(r->profiles.u[k]);
    if (!r->used[k]) continue;
    const double weight = r->profiles.weight[k];
    r->normal += weight * rows[k].transpose() * rows[k];
    right += weight * rows[k].transpose() * r->residuals[i];
  }
  const Eigen::LDLT<Matrix5d> solver(r->normal);
  if (solver.info() != Eigen::Success || !solver.isPositive()) return std::nullopt;
  const Vector5d step = solver.solve(right);
  const auto moved = r->frame.Moved(step);
  if (!moved || step.norm() > 3.0) return std::nullopt;
  r->frame = *moved;
  for (int i = 0; i < n; ++i) r->residuals[i] -= rows[static_cast<std::size_t>(i)] * step;
  return step.norm();
}

template <typename T>
std::optional<Refinement> Refine(const SignedImage<T>& image, const Ellipse& start,
                                 const RecognitionOptions& options) {
  Refinement r;
  r.frame = EllipseFrame::From(start);
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const Ellipse now = r.frame.ToEllipse();
    if (!(now.semi_minor_px > 0.4 * options.diameter_px[0]) ||
        !(now.semi_major_px < 0.6 * options.diameter_px[1]) || !image.Covers(now.x_px, now.y_px)) {
      return std::nullopt;
    }
    r.profiles = SampleProfiles(image, r.frame);
    auto levels = MeasureLevels(r.profiles);
    if (!levels) return std::nullopt;
    r.levels = std::move(*levels);
    EdgeOffsets offsets = MeasureOffsets(r.profiles, r.levels);
    r.residuals = std::move(offsets.distance_px);
    r.shift_variance_px2 = offsets.shift_variance_px2;
    r.size_variance_px2 = offsets.size_variance_px2;
    r.used.assign(static_cast<std::size_t>(r.profiles.count()), 1);
    SelectProfiles(&r);
    const auto length = Step(&r);
    if (!length) return std::nullopt;
    if (*length < 0.05) break;  // the next step would be of second order in it
  }
  return r;
}

/// Longest run of profiles that are left out or lack contrast, as a fraction of all.
double WorstRun(const Refinement& r) {
  const int n = r.profiles.count();
  const auto fails = [&](int i) {
    // Means of three neighbours: noise alone must not fail a profile.
    float contrast = 0;
    for (int k = n - 1; k <= n + 1; ++k) {
      const int j = (i + k) % n;
      contrast += r.profiles.grey(j, r.levels.inner) - r.profiles.grey(j, r.levels.outer);
    }
    const float expected = (r.levels.inside - r.levels.outside).mean();
    return !r.used[static_cast<std::size_t>(i)] || contrast / 3 < 0.4f * expected;
  };
  int run = 0, worst = 0;
  for (int i = 0; i < 2 * n; ++i) {
    run = fails(i % n) ? run + 1 : 0;
    worst = std::max(worst, run);
  }
  return std::min(1.0, static_cast<double>(worst) / n);
}

/// What the residuals of the profiles used sum up to.
struct ResidualSum {
  double squares = 0.0, weight = 0.0;
  int used = 0;
  double noise = 0.0;  ///< variance of what differs between profiles two apart

  double variance() const { return squares / weight; }
};

ResidualSum SumResiduals(const Refinement& r) {
  ResidualSum sum;
  const int n = r.profiles.count();
  int pairs = 0;
  for (int i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (!r.used[k]) continue;
    sum.squares += r.profiles.weight[k] * r.residuals[i] * r.residuals[i];
    sum.weight += r.profiles.weight[k];
    ++sum.used;
    const int next = (i + 2) % n;
    if (!r.used[static_cast<std::size_t>(next)]) continue;
    const double difference = r.residuals[i] - r.residuals[next];
    sum.noise += 0.5 * difference * difference;
    ++pairs;
  }
  sum.noise /= std::max(1, pairs);
  return sum;
}

/// Whether the dot's middle is as bright as the inner side of its edge: a ring is no dot.
template <typename T>
bool IsFilled(const SignedImage<T>& image, const Refinement& r) {
  const float inside = r.levels.inside.mean(), outside = r.levels.outside.mean();
  const float least = outside + 0.4f * (inside - outside);
  int dark = 0;
  for (const Eigen::Vector2d& u :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(0.4, 0), Eigen::Vector2d(0, 0.4),
        Eigen::Vector2d(-0.4, 0), Eigen::Vector2d(0, -0.4)}) {
    const Eigen::Vector2f p = r.frame.Point(u).cast<float>();
    dark += image.Bilinear(p.x(), p.y()) < least;
  }
  return dark <= 1;
}

/// Whether the grey values level off within the profiles, on both sides.
///
/// A print's edge is as wide as the picture is blurred, whatever the dot's size;
/// a reflection fades with its own size and still falls where the profiles end.
/// A quarter of the steepest fall there is that of a blur of 3.5 px / sqrt(2 ln 4)
/// = 2.1 px, far more than a picture to measure in has. The profiles of dots
/// under 8 px are shorter and tell nothing of it.
bool EdgeEnds(const EdgeProfiles& profiles, const EdgeLevels& levels) {
  if (profiles.inward < kProfileInward || profiles.outward < kProfileOutward) return true;
  const Eigen::Index last = levels.mean_fall.size() - 2;
  const float limit = 0.25f * levels.mean_fall.maxCoeff();
  return levels.mean_fall[1] < limit && levels.mean_fall[last] < limit;
}

/// Whether this is a dot; see MeasureTargetEdge, 3.
bool IsDot(const Refinement& r, const Ellipse& e, const ResidualSum& sum, double independent) {
  if (WorstRun(r) > 0.08) return false;
  if (r.levels.width_px > 0.45 * e.semi_minor_px + 0.3) return false;
  if (!EdgeEnds(r.profiles, r.levels)) return false;
  if (r.levels.uneven_outside > kMostUneven) return false;
  // Noise differs from profile to profile, a wrong shape does not: a square's
  // residuals are 0.05 of its radius, a finger's or a lamp's more.
  const double shape_limit = 0.04 + 0.008 * e.semi_minor_px;
  const double chance = 3.0 * std::sqrt(2.0 / std::max(4.0, independent)) * sum.noise;
  if (sum.variance() - sum.noise > shape_limit * shape_limit + chance) return false;
  return std::sqrt(sum.variance()) < 0.15 + 0.02 * e.semi_minor_px;
}

/// The ellipse before it was blurred.
///
/// Blur of variance s^2 moves the half-way contour towards the centre of
/// curvature by s^2 k / 2 (a disc of radius r looks s^2 / (2 r) smaller); at the
/// ends of the axes k = a / b^2 and b / a^2. The edge's measured spread holds
/// 1/12 px^2 of the difference quotient that it was measured with.
Ellipse WithoutBlur(Ellipse e, double width_px) {
  const double a = e.semi_major_px, b = e.semi_minor_px;
  const double half_variance = 0.5 * std::max(0.0, width_px * width_px - 1.0 / 12.0);
  // A dot not much larger than its blur is no longer described to first order.
  e.semi_major_px += std::min(half_variance * a / (b * b), 0.1 * a);
  e.semi_minor_px += std::min(half_variance * b / (a * a), 0.1 * b);
  return e;
}

TargetEdge Summarise(const Refinement& r, const Ellipse& e, const ResidualSum& sum,
                     double independent) {
  TargetEdge edge;
  edge.ellipse = e;
  edge.edge_rms_px = std::sqrt(sum.variance());
  edge.inside = r.levels.inside.mean();
  edge.outside = r.levels.outside.mean();
  edge.width_px = r.levels.width_px;
  edge.inside_glare = r.levels.inside_glare;
  edge.outside_glare = r.levels.outside_glare;
  // The residuals' mean square lacks the part that the five parameters took.
  const double variance = sum.variance() * independent / std::max(1.0, independent - 5.0);
  const Matrix5d inverse = r.normal.ldlt().solve(Matrix5d::Identity());
  const Matrix5d jacobian = r.frame.EllipseJacobian();
  const double spread = sum.weight / independent;
  // (weights are lengths: weight / independent profiles share one observation)
  const Matrix5d cov = variance * spread * jacobian * inverse * jacobian.transpose();
  edge.cov = 0.5 * (cov + cov.transpose());  // rounding
  edge.cov(0, 0) += r.shift_variance_px2;
  edge.cov(1, 1) += r.shift_variance_px2;
  edge.cov.block<2, 2>(2, 2).array() += r.size_variance_px2;
  BoundDirection(&edge.cov);
  return edge;
}

}  // namespace

template <typename T>
std::optional<TargetEdge> MeasureTargetEdge(const SignedImage<T>& image, const Candidate& candidate,
                                            const RecognitionOptions& options) {
  if (!HasContrastAllAround(image, candidate)) return std::nullopt;
  const auto start = EllipseFromCanny(image, candidate.ellipse);
  if (!start) return std::nullopt;
  const auto refined = Refine(image, *start, options);
  if (!refined) return std::nullopt;
  const Ellipse e = WithoutBlur(refined->frame.ToEllipse(), refined->levels.width_px);
  if (2 * e.semi_minor_px < options.diameter_px[0] ||
      2 * e.semi_major_px > options.diameter_px[1]) {
    return std::nullopt;
  }
  const ResidualSum sum = SumResiduals(*refined);
  if (sum.used < 0.85 * refined->profiles.count()) return std::nullopt;
  const double independent =
      std::min<double>(sum.used, refined->profiles.perimeter_px / kCorrelationPx * sum.used /
                                     refined->profiles.count());
  if (!IsDot(*refined, e, sum, independent) || !IsFilled(image, *refined)) return std::nullopt;
  return Summarise(*refined, e, sum, independent);
}

template std::optional<TargetEdge> MeasureTargetEdge(const SignedImage<std::uint8_t>&,
                                                     const Candidate&, const RecognitionOptions&);
template std::optional<TargetEdge> MeasureTargetEdge(const SignedImage<std::uint16_t>&,
                                                     const Candidate&, const RecognitionOptions&);

}  // namespace videogrammetry
