#include "videogrammetry/recognition/edge_profile.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace videogrammetry {
namespace {

/// Mean and first harmonic of `values` along the contour.
Eigen::ArrayXf SmoothAlongContour(const EdgeProfiles& profiles, const Eigen::ArrayXf& values) {
  Eigen::Matrix3f normal = Eigen::Matrix3f::Zero();
  Eigen::Vector3f right = Eigen::Vector3f::Zero();
  for (int i = 0; i < profiles.count(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Eigen::Vector3f row(1.0f, static_cast<float>(profiles.u[k].x()),
                              static_cast<float>(profiles.u[k].y()));
    normal += profiles.weight[k] * row * row.transpose();
    right += profiles.weight[k] * values[i] * row;
  }
  const Eigen::Vector3f solution = normal.ldlt().solve(right);
  Eigen::ArrayXf smooth(profiles.count());
  for (int i = 0; i < profiles.count(); ++i) {
    const auto& u = profiles.u[static_cast<std::size_t>(i)];
    smooth[i] = solution[0] + solution[1] * static_cast<float>(u.x()) +
                solution[2] * static_cast<float>(u.y());
  }
  return smooth;
}

}  // namespace

template <typename T>
EdgeProfiles SampleProfiles(const SignedImage<T>& image, const EllipseFrame& frame) {
  const Ellipse e = frame.ToEllipse();
  const double a = e.semi_major_px, b = e.semi_minor_px;
  EdgeProfiles p;
  // Ramanujan's approximation.
  p.perimeter_px = std::numbers::pi * (3 * (a + b) - std::sqrt((3 * a + b) * (a + 3 * b)));
  const int count = std::clamp(static_cast<int>(std::lround(p.perimeter_px)), 24, 360);
  // Not across the middle: the other side's edge would be counted.
  p.inward = std::clamp(static_cast<int>(0.9 * b / kProfileStepPx), 2, kProfileReach);
  p.outward = kProfileReach;
  p.u.resize(static_cast<std::size_t>(count));
  p.weight.resize(static_cast<std::size_t>(count));
  p.grey.resize(count, p.samples());
  const Eigen::Vector2d reach =
      frame.shape.rowwise().norm() + Eigen::Vector2d::Constant(kProfileStepPx * kProfileReach);
  const bool inside =
      image.Covers(frame.center.x() - reach.x(), frame.center.y() - reach.y()) &&
      image.Covers(frame.center.x() + reach.x(), frame.center.y() + reach.y());
  const double turn = 2 * std::numbers::pi / count;
  const Eigen::Rotation2Dd rotation(turn);
  const Eigen::Matrix2d next = rotation.toRotationMatrix();
  Eigen::Vector2d u(1.0, 0.0);
  double total = 0;
  for (int i = 0; i < count; ++i, u = next * u) {
    const auto k = static_cast<std::size_t>(i);
    const Eigen::Vector2d point = frame.Point(u), normal = frame.Normal(u);
    p.u[k] = u;
    p.weight[k] = static_cast<float>((frame.shape * Eigen::Vector2d(-u.y(), u.x())).norm());
    total += p.weight[k];
    const auto nx = static_cast<float>(normal.x()), ny = static_cast<float>(normal.y());
    const float step_x = kProfileStepPx * nx, step_y = kProfileStepPx * ny;
    const float px = static_cast<float>(point.x()) - static_cast<float>(p.inward) * step_x;
    const float py = static_cast<float>(point.y()) - static_cast<float>(p.inward) * step_y;
    float* grey = &p.grey(i, 0);
    for (int j = 0; j < p.samples(); ++j) {
      const float x = px + static_cast<float>(j) * step_x, y = py + static_cast<float>(j) * step_y;
      grey[j] = inside ? image.BilinearInside(x, y) : image.Bilinear(x, y);
    }
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
  int inner = peak, outer = peak;
  while (inner > 0 && levels.mean_fall[inner] > least) --inner;
  while (outer + 1 < n && levels.mean_fall[outer] > least) ++outer;
  outer = std::min(outer, n - 1);
  levels.inner = inner;
  levels.outer = outer;
  double weight = 0, first = 0, second = 0;
  for (int j = inner; j <= outer; ++j) {
    const double f = std::max(0.0f, levels.mean_fall[j]);
    const double d = kProfileStepPx * static_cast<double>(j - p.inward);
    weight += f;
    first += f * d;
    second += f * d * d;
  }
  if (!(weight > 0)) return std::nullopt;
  levels.width_px = std::sqrt(std::max(0.01, second / weight - first * first / (weight * weight)));
  levels.inside = SmoothAlongContour(p, p.grey.col(inner));
  levels.outside = SmoothAlongContour(p, p.grey.col(outer));
  return levels;
}

Eigen::ArrayXd EdgeOffsets(const EdgeProfiles& p, const EdgeLevels& levels) {
  // The weight is symmetric about the ellipse, or noise-free edges would move.
  const int reach = std::min({p.inward, p.outward,
                              std::max(2, static_cast<int>(std::ceil(2.0 * levels.width_px /
                                                                     kProfileStepPx)))});
  Eigen::ArrayXf g(2 * reach + 1);
  float slope = 0, total = 0;
  for (int k = -reach; k <= reach; ++k) {
    const double d = kProfileStepPx * k / levels.width_px;
    g[k + reach] = static_cast<float>(std::exp(-0.5 * d * d));
    const float f = std::max(0.0f, levels.mean_fall[p.inward + k]);
    slope += g[k + reach] * f;
  }
  for (int j = levels.inner; j <= levels.outer; ++j) total += std::max(0.0f, levels.mean_fall[j]);
  slope /= std::max(total, 1e-6f);
  Eigen::ArrayXd offsets(p.count());
  for (int i = 0; i < p.count(); ++i) {
    const float half_way = 0.5f * (levels.inside[i] + levels.outside[i]);
    const float contrast = levels.inside[i] - levels.outside[i];
    float sum = 0;
    for (int k = -reach; k <= reach; ++k) {
      sum += g[k + reach] * (p.grey(i, p.inward + k) - half_way);
    }
    offsets[i] = contrast > 0 ? kProfileStepPx * sum / (contrast * slope) : 1e3;
  }
  return offsets;
}

template EdgeProfiles SampleProfiles(const SignedImage<std::uint8_t>&, const EllipseFrame&);
template EdgeProfiles SampleProfiles(const SignedImage<std::uint16_t>&, const EllipseFrame&);

}  // namespace videogrammetry
