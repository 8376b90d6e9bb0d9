#include "videogrammetry/recognition/edge_profile.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace videogrammetry {
namespace {

/// Prior standard deviation of a plateau's first harmonic, in units of the
/// contrast: light seldom changes by more across a dot. Inside, and outside
/// where a ring of code is near, it is taken for the brighter side: light
/// multiplies, so black paper hardly shows it, and what changes there along the
/// contour is the ring's edge.
constexpr double kPriorGradient = 0.02;
/// What light that is added (flare) may change, in units of the contrast.
constexpr double kPriorFlare = 0.002;
/// A plateau's columns beyond the edge's end that are averaged at most, and how
/// level they are, in units of the contrast.
constexpr int kPlateauColumns = 3;
constexpr float kPlateauFlatness = 0.03f;
/// From which distance on a fall of 15 % of the steepest ends an edge, not 5 %.
constexpr float kFarPx = 2.5f;
/// From which share of the contrast on a first harmonic is glare, and the part of
/// it that is curved over the dot and so not described.
constexpr double kGlare = 3.0 * kPriorGradient, kGlareCurve = 0.7;
/// How far before a ring of code its edge is felt, in widths of the dot's own edge.
constexpr double kRingReach = 2.5;
/// Width of the weight of the mean gradient as a part of the edge's own.
constexpr double kWeightWidth = 0.5;
/// Length of contour over which neighbouring profiles share their pixels.
constexpr double kSharedPx = 1.5;

/// Values along the contour, smoothed.
struct Harmonic {
  Eigen::ArrayXf values;
  double amplitude = 0.0;      ///< of the first harmonic, as measured
  double noise = 0.0;          ///< variance of either of its coefficients as measured,
  double variance = 0.0;       ///< and as smoothed
  double mean_variance = 0.0;  ///< of the mean
};

/// Mean of the columns first ... last of each profile, smoothed along the
/// contour to its mean and first harmonic; the harmonic is held towards zero
/// by the prior where noise says little about it.
Harmonic SmoothColumns(const EdgeProfiles& profiles, int first, int last, double prior_sigma) {
  const Eigen::ArrayXf values = profiles.grey.middleCols(first, last - first + 1).rowwise().mean();
  Eigen::Matrix3f normal = Eigen::Matrix3f::Zero();
  Eigen::Vector3f right = Eigen::Vector3f::Zero();
  const auto row_of = [&](int i) {
    const auto& u = profiles.u[static_cast<std::size_t>(i)];
    return Eigen::Vector3f(1.0f, static_cast<float>(u.x()), static_cast<float>(u.y()));
  };
  for (int i = 0; i < profiles.count(); ++i) {
    const Eigen::Vector3f row = row_of(i);
    const float weight = profiles.weight[static_cast<std::size_t>(i)];
    normal += weight * row * row.transpose();
    right += weight * values[i] * row;
  }
  Eigen::Vector3f solution = normal.ldlt().solve(right);
  double squares = 0;
  for (int i = 0; i < profiles.count(); ++i) {
    const float residual = values[i] - row_of(i).dot(solution);
    squares += residual * residual;
  }
  // Inside a small dot the columns run on a short way around its middle.
  const double offset = kProfileStepPx * (0.5 * (first + last) - profiles.inward);
  const double contour = profiles.perimeter_px + 2 * std::numbers::pi * offset;
  const double independent = std::max(4.0, contour / kSharedPx);
  const double noise = 2.0 * squares / profiles.count() / std::max(1.0, independent - 3.0);
  const double prior = prior_sigma * prior_sigma;
  const double trust = prior / (prior + noise);
  Harmonic smooth;
  smooth.amplitude = solution.tail<2>().norm();
  smooth.noise = noise;
  solution.tail<2>() *= static_cast<float>(trust);
  smooth.variance = trust * noise;
  smooth.mean_variance = 0.5 * noise;
  smooth.values.resize(profiles.count());
  for (int i = 0; i < profiles.count(); ++i) smooth.values[i] = row_of(i).dot(solution);
  return smooth;
}

/// One side's level, and the amplitude of a harmonic that is more than the light's.
struct Level {
  Harmonic smooth;
  double glare = 0.0;   ///< 0, or the first harmonic, where it is glare
  double excess = 0.0;  ///< of the harmonic over its noise
};

/// The level of the columns first ... last. A harmonic beyond what light varies
/// by, and by more than noise, is added light (glare): it is followed as measured.
/// @param glare  that of the other side, which lies on this one too.
Level MeasureLevel(const EdgeProfiles& profiles, int first, int last, double prior, double glare,
                   double contrast) {
  Level level;
  level.smooth = SmoothColumns(profiles, first, last, prior + glare);
  const double amplitude = level.smooth.amplitude;
  level.excess = amplitude - 3.0 * std::sqrt(level.smooth.noise);
  if (level.excess > kGlare * contrast) {
    level.glare = amplitude;
    level.smooth = SmoothColumns(profiles, first, last, amplitude);
  }
  return level;
}

}  // namespace

template <typename T>
EdgeProfiles SampleProfiles(const SignedImage<T>& image, const EllipseFrame& frame) {
  const Ellipse e = frame.ToEllipse();
  const double a = e.semi_major_px, b = e.semi_minor_px;
  EdgeProfiles p;
  p.semi_minor_px = b;
  // Ramanujan's approximation.
  p.perimeter_px = std::numbers::pi * (3 * (a + b) - std::sqrt((3 * a + b) * (a + 3 * b)));
  const int count = std::clamp(static_cast<int>(std::lround(p.perimeter_px)), 24, 360);
  // Not across the middle: the other side's edge would be counted.
  p.inward = std::clamp(static_cast<int>(0.9 * b / kProfileStepPx), 2, kProfileInward);
  p.outward = kProfileOutward;
  p.u.resize(static_cast<std::size_t>(count));
  p.weight.resize(static_cast<std::size_t>(count));
  p.grey.resize(count, p.samples());
  const Eigen::Vector2d reach =
      frame.shape.rowwise().norm() + Eigen::Vector2d::Constant(kProfileStepPx * kProfileInward);
  const Eigen::Matrix2d next = Eigen::Rotation2Dd(2 * std::numbers::pi / count).toRotationMatrix();
  const int samples = p.samples();
  std::vector<float> x(static_cast<std::size_t>(count * samples)), y(x.size());
  Eigen::Vector2d u(1.0, 0.0);
  double total = 0;
  for (int i = 0; i < count; ++i, u = next * u) {
    const auto k = static_cast<std::size_t>(i);
    const Eigen::Vector2d point = frame.Point(u), normal = frame.Normal(u);
    p.u[k] = u;
    p.weight[k] = static_cast<float>((frame.shape * Eigen::Vector2d(-u.y(), u.x())).norm());
    total += p.weight[k];
    const float step_x = kProfileStepPx * static_cast<float>(normal.x());
    const float step_y = kProfileStepPx * static_cast<float>(normal.y());
    const float first_x = static_cast<float>(point.x()) - static_cast<float>(p.inward) * step_x;
    const float first_y = static_cast<float>(point.y()) - static_cast<float>(p.inward) * step_y;
    float* row_x = &x[k * static_cast<std::size_t>(samples)];
    float* row_y = &y[k * static_cast<std::size_t>(samples)];
    for (int j = 0; j < samples; ++j) {
      row_x[j] = first_x + static_cast<float>(j) * step_x;
      row_y[j] = first_y + static_cast<float>(j) * step_y;
    }
  }
  if (image.CoversAround(frame.center.x(), frame.center.y(), reach.x(), reach.y())) {
    image.Sample(x.data(), y.data(), count * samples, p.grey.data());
  } else {
    for (std::size_t k = 0; k < x.size(); ++k) p.grey.data()[k] = image.Bilinear(x[k], y[k]);
  }
  for (float& weight : p.weight) weight *= static_cast<float>(count / total);
  return p;
}

std::optional<EdgeLevels> MeasureLevels(const EdgeProfiles& p) {
  const int n = p.samples();
  Eigen::ArrayXf mean = Eigen::ArrayXf::Zero(n);
  for (int i = 0; i < p.count(); ++i) {
    mean += p.weight[static_cast<std::size_t>(i)] * p.grey.row(i).transpose();
  }
  mean /= static_cast<float>(p.count());
  EdgeLevels levels;
  levels.mean_fall = Eigen::ArrayXf::Zero(n);
  for (int j = 1; j + 1 < n; ++j) levels.mean_fall[j] = 0.5f * (mean[j - 1] - mean[j + 1]);
  int peak = p.inward;
  for (int j = std::max(1, p.inward - 2); j <= p.inward + 2; ++j) {
    if (levels.mean_fall[j] > levels.mean_fall[peak]) peak = j;
  }
  const float least = 0.05f * levels.mean_fall[peak];
  if (!(least > 0)) return std::nullopt;
  // Glare lets the grey values fall on, slowly: that is no part of the edge.
  const auto ends = [&](int j) {
    const bool far = std::abs(j - peak) * kProfileStepPx >= kFarPx;
    return levels.mean_fall[j] <= (far ? 3.0f : 1.0f) * least;
  };
  int inner = peak, outer = peak;
  while (inner > 0 && !ends(inner)) --inner;
  while (outer + 1 < n && !ends(outer)) ++outer;
  levels.inner = inner;
  levels.outer = outer;
  double weight = 0, moment = 0, second = 0;
  for (int j = inner; j <= outer; ++j) {
    const double f = std::max(0.0f, levels.mean_fall[j]);
    const double d = kProfileStepPx * static_cast<double>(j - p.inward);
    weight += f;
    moment += f * d;
    second += f * d * d;
  }
  if (!(weight > 0)) return std::nullopt;
  levels.width_px =
      std::sqrt(std::max(0.01, second / weight - moment * moment / (weight * weight)));
  // As much of the plateaus as there is, up to 1.5 px: less noise.
  const float contrast = mean[inner] - mean[outer];
  int first = inner, last = outer;
  const auto flat = [&](int j, int edge) {
    return std::abs(mean[j] - mean[edge]) < kPlateauFlatness * contrast;
  };
  while (first > 0 && inner - first < kPlateauColumns && flat(first - 1, inner)) --first;
  // A ring of code begins a radius away, at the earliest, and its blurred edge
  // before: a few per cent of it would move the half-way level.
  const double free_px = p.semi_minor_px - kRingReach * levels.width_px;
  const int before_ring = p.inward + static_cast<int>(std::floor(free_px / kProfileStepPx));
  while (last + 1 < n && last - outer < kPlateauColumns && last < before_ring &&
         flat(last + 1, outer)) {
    ++last;
  }
  const double bright = std::max(std::abs(mean[inner]), std::abs(mean[outer]));
  const auto by_light = [&](float level) {
    return contrast * (kPriorFlare + kPriorGradient * std::abs(level) / bright);
  };
  const Level inside = MeasureLevel(p, first, inner, by_light(mean[inner]), 0.0, contrast);
  // A ring too near for the ground to be free of it would pass for a gradient.
  const bool ring_near = outer > before_ring;
  const double prior = ring_near ? by_light(mean[outer]) : kPriorGradient * contrast;
  const Level outside = MeasureLevel(p, outer, last, prior, inside.glare, contrast);
  levels.uneven_outside = std::max(0.0, outside.excess - inside.glare) / contrast;
  levels.inside_glare = inside.glare;
  levels.outside_glare = outside.glare;
  levels.inside = inside.smooth.values;
  levels.outside = outside.smooth.values;
  const double curved = kGlareCurve * std::max(inside.glare, outside.glare);
  levels.gradient_variance =
      0.25 * (inside.smooth.variance + outside.smooth.variance + 2.0 * curved * curved);
  levels.mean_variance = 0.25 * (inside.smooth.mean_variance + outside.smooth.mean_variance);
  return levels;
}

EdgeOffsets MeasureOffsets(const EdgeProfiles& p, const EdgeLevels& levels) {
  // The weight is symmetric about the ellipse, or noise-free edges would move.
  const double width = kWeightWidth * levels.width_px / kProfileStepPx;
  const int reach =
      std::min({p.inward, p.outward, std::max(2, static_cast<int>(std::ceil(2.5 * width)))});
  Eigen::ArrayXf g(2 * reach + 1);
  float slope = 0, total = 0;
  for (int k = -reach; k <= reach; ++k) {
    g[k + reach] = static_cast<float>(std::exp(-0.5 * k * k / (width * width)));
    slope += g[k + reach] * std::max(0.0f, levels.mean_fall[p.inward + k]);
  }
  for (int j = levels.inner; j <= levels.outer; ++j) total += std::max(0.0f, levels.mean_fall[j]);
  slope /= std::max(total, 1e-6f);
  EdgeOffsets offsets;
  offsets.distance_px.resize(p.count());
  const float mean_contrast = (levels.inside - levels.outside).mean();
  const double shift = kProfileStepPx * g.sum() / (mean_contrast * slope);
  offsets.shift_variance_px2 = levels.gradient_variance * shift * shift;
  offsets.size_variance_px2 = levels.mean_variance * shift * shift;
  for (int i = 0; i < p.count(); ++i) {
    const float half_way = 0.5f * (levels.inside[i] + levels.outside[i]);
    const float contrast = levels.inside[i] - levels.outside[i];
    float sum = 0;
    for (int k = -reach; k <= reach; ++k) {
      sum += g[k + reach] * (p.grey(i, p.inward + k) - half_way);
    }
    offsets.distance_px[i] = contrast > 0 ? kProfileStepPx * sum / (contrast * slope) : 1e3;
  }
  return offsets;
}

template EdgeProfiles SampleProfiles(const SignedImage<std::uint8_t>&, const EllipseFrame&);
template EdgeProfiles SampleProfiles(const SignedImage<std::uint16_t>&, const EllipseFrame&);

}  // namespace videogrammetry
