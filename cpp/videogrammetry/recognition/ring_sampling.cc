#include "videogrammetry/recognition/ring_sampling.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace videogrammetry {
namespace {

/// cos and sin of the directions of a circle's samples.
template <int kPerSector>
struct Directions {
  std::array<float, kPerSector * kMaxCodeBits> cosine = {}, sine = {};

  Directions(int num_bits, double offset) {
    const int count = kPerSector * num_bits;
    for (int i = 0; i < count; ++i) {
      const double t = 2 * std::numbers::pi * (i + offset) / count;
      cosine[static_cast<std::size_t>(i)] = static_cast<float>(std::cos(t));
      sine[static_cast<std::size_t>(i)] = static_cast<float>(std::sin(t));
    }
  }
};

/// One table for every number of sectors, built once. (0, 0) follows the last direction.
template <int kPerSector>
const Directions<kPerSector>& DirectionsOf(int num_bits) {
  static const auto tables = [] {
    std::vector<Directions<kPerSector>> all;
    for (int n = 0; n <= kMaxCodeBits; ++n) all.emplace_back(n, 0.5);
    return all;
  }();
  return tables[static_cast<std::size_t>(num_bits)];
}

}  // namespace

/// E R(turn).
struct RingSampler::Turned {
  double xx, xy, yx, yy;

  Turned(const RingSampler& s, double turn_rad) {
    const double c = std::cos(turn_rad), n = std::sin(turn_rad);
    xx = s.xx_ * c + s.xy_ * n;
    xy = s.xy_ * c - s.xx_ * n;
    yx = s.xy_ * c + s.yy_ * n;
    yy = s.yy_ * c - s.xy_ * n;
  }
};

RingSampler::RingSampler(const GreySampler& picture, const TargetEdge& dot,
                         const CodeFamily& family)
    : picture_(picture), family_(family), x_(dot.ellipse.x_px), y_(dot.ellipse.y_px) {
  // E = R diag(a, b) R^T, as EllipseFrame has it.
  const double c = std::cos(dot.ellipse.angle_rad), s = std::sin(dot.ellipse.angle_rad);
  const double a = dot.ellipse.semi_major_px, b = dot.ellipse.semi_minor_px;
  xx_ = a * c * c + b * s * s;
  xy_ = (a - b) * c * s;
  yy_ = a * s * s + b * c * c;
  reach_x_ = std::sqrt(xx_ * xx_ + xy_ * xy_);
  reach_y_ = std::sqrt(xy_ * xy_ + yy_ * yy_);
  outside_ = static_cast<float>(dot.outside);
  scale_ = static_cast<float>(1.0 / (dot.inside - dot.outside));
  blur_px_ = std::clamp(dot.width_px, 0.4, 0.6 * b);
  edge_sigma_px_ = dot.edge_rms_px;
  exact_axes_ = dot.exact_axes;
}

bool RingSampler::Circle(const Turned& turned, double radius, int per_sector, float* values) const {
  const int count = per_sector * family_.num_bits;
  const float *cosine, *sine;
  if (per_sector == kRingPerSector) {
    const auto& table = DirectionsOf<kRingPerSector>(family_.num_bits);
    cosine = table.cosine.data(), sine = table.sine.data();
  } else {
    const auto& table = DirectionsOf<kBesidePerSector>(family_.num_bits);
    cosine = table.cosine.data(), sine = table.sine.data();
  }
  const auto xx = static_cast<float>(radius * turned.xx),
             xy = static_cast<float>(radius * turned.xy);
  const auto yx = static_cast<float>(radius * turned.yx),
             yy = static_cast<float>(radius * turned.yy);
  // Coordinates count from the circle's upper left corner.
  const double reach_x = radius * reach_x_ + 0.01, reach_y = radius * reach_y_ + 0.01;
  const double left = std::floor(x_ - reach_x), top = std::floor(y_ - reach_y);
  const auto cx = static_cast<float>(x_ - left), cy = static_cast<float>(y_ - top);
  // Whole groups of places: beyond the table's end they are the dot's centre.
  constexpr int kGroup = 16;
  const int padded = (count + kGroup - 1) / kGroup * kGroup;
  std::array<float, kRingPerSector * kMaxCodeBits> x, y;
  for (int i = 0; i < padded; ++i) {
    x[static_cast<std::size_t>(i)] = cx + (xx * cosine[i] + xy * sine[i]);
    y[static_cast<std::size_t>(i)] = cy + (yx * cosine[i] + yy * sine[i]);
  }
  bool whole =
      picture_.Covers(x_ - reach_x, y_ - reach_y) && picture_.Covers(x_ + reach_x, y_ + reach_y);
  if (whole) {
    picture_.Sample(static_cast<int>(left), static_cast<int>(top),
                    static_cast<int>(y_ + reach_y) + 1, x.data(), y.data(), padded, values);
  } else {
    whole = true;
    for (int i = 0; i < count; ++i) {
      const double px = left + double{x[static_cast<std::size_t>(i)]};
      const double py = top + double{y[static_cast<std::size_t>(i)]};
      const bool covered = picture_.Covers(px, py);
      values[i] = covered ? picture_.At(px, py) : std::numeric_limits<float>::quiet_NaN();
      whole &= covered;
    }
  }
  for (int i = 0; i < count; ++i) values[i] = (values[i] - outside_) * scale_;
  return whole;
}

bool RingSampler::Middle(BesideCircle* values) const {
  return MiddleFrom(-0.5 / kBesidePerSector, values);
}

bool RingSampler::MiddleFrom(double phase, BesideCircle* values) const {
  const double turn = phase * 2 * std::numbers::pi / family_.num_bits;
  return Circle(Turned(*this, turn), 0.5 * (family_.ring_inner + family_.ring_outer),
                kBesidePerSector, values->data());
}

void RingSampler::Gap(BesideCircle* values) const {
  Circle(Turned(*this, 0.0), 1.0 + 0.55 * (family_.ring_inner - 1.0), kBesidePerSector,
         values->data());
}

bool RingSampler::Sample(double phase, RingSamples* samples) const {
  const int n = family_.num_bits;
  const double sector_rad = 2 * std::numbers::pi / n;
  const double inner = family_.ring_inner, width = family_.ring_outer - family_.ring_inner;
  const Turned turned(*this, phase * sector_rad);
  samples->num_bits = n;
  if (!Circle(turned, inner + 0.2 * width, kRingPerSector, samples->inner.data())) return false;
  Circle(turned, inner + 0.5 * width, kRingPerSector, samples->middle.data());
  Circle(turned, inner + 0.8 * width, kRingPerSector, samples->outer.data());
  Circle(turned, inner + 1.2 * width, kBesidePerSector, samples->outside.data());
  // A border of two sectors runs along E u: sectors are rho dt det E / |E u| long
  // across it. The ring's borders have the normal E^-1 u: |E^-1 u| = |E u'| / det E
  // with u' at right angles to u, and the ring is (outer - inner) / |E^-1 u| wide.
  const double det = xx_ * yy_ - xy_ * xy_;
  const double length = (inner + 0.5 * width) * sector_rad * det;
  const auto along = static_cast<float>(blur_px_ / length);
  const auto across = static_cast<float>(blur_px_ / (det * width));
  const auto exx = static_cast<float>(turned.xx), exy = static_cast<float>(turned.xy);
  const auto eyx = static_cast<float>(turned.yx), eyy = static_cast<float>(turned.yy);
  const auto& table = DirectionsOf<1>(n);
  const auto blur = static_cast<float>(blur_px_);
  for (int k = 0; k < n; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const float c = table.cosine[at], s = table.sine[at];
    const float ux = exx * c + exy * s, uy = eyx * c + eyy * s;
    const float vx = exy * c - exx * s, vy = eyy * c - eyx * s;
    samples->blur_along[at] = along * std::sqrt(ux * ux + uy * uy);
    samples->blur_across[at] = across * std::sqrt(vx * vx + vy * vy);
    samples->length_px[at] = blur / samples->blur_along[at];
  }
  samples->edge_sigma_px = static_cast<float>(edge_sigma_px_);
  // An edge's slope is 1 / (sqrt(2 pi) blur).
  samples->grey_sigma = static_cast<float>(edge_sigma_px_ / (2.507 * blur_px_));
  return true;
}

double RingSampler::LargestScale() const {
  // 0.8 (blur / radius)^2, a fifth more at most, and less than a tenth: families' rings
  // differ by more.
  if (exact_axes_) return 1.0;
  const double det = xx_ * yy_ - xy_ * xy_;
  return 1.0 + std::min(0.1, blur_px_ * blur_px_ / det);
}

void RingSampler::Scale(double factor) {
  xx_ *= factor;
  xy_ *= factor;
  yy_ *= factor;
  reach_x_ *= factor;
  reach_y_ *= factor;
}

}  // namespace videogrammetry
