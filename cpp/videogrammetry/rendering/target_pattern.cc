#include "videogrammetry/rendering/target_pattern.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace videogrammetry {
namespace {

constexpr int kMaxBorders = 40;  // four circles or sides, 32 sectors

}  // namespace

/// Sorted places in (0, 1) where a line crosses borders.
struct TargetPattern::Cuts {
  std::array<float, 2 * kMaxBorders + 2> at;
  int count = 0;

  void Add(float t) {
    if (t > 0 && t < 1) at[count++] = t;
  }
  void AddCircle(float u, float v, float du, float dv, float radius);
};

void TargetPattern::Cuts::AddCircle(float u, float v, float du, float dv, float radius) {
  const float a = du * du + dv * dv, b = u * du + v * dv;
  const float root2 = b * b - a * (u * u + v * v - radius * radius);
  if (!(root2 > 0) || !(a > 0)) return;
  const float root = std::sqrt(root2);
  // The root without cancellation, and the other from the product c / a.
  const float q = b > 0 ? -b - root : -b + root;
  Add(q / a);
  if (q != 0) Add((u * u + v * v - radius * radius) / q);
}

struct TargetPattern::Crossed {
  bool any = false;
  bool dot = false, inner = false, outer = false, sticker = false;
  bool general = false;      // sectors by angle, not by the nearest borders
  int first = 0, last = -1;  // sector borders, may be negative or beyond num_bits
  int sector = 0;            // of the cell's middle
  // Normal of the nearest border in the plane.
  float normal_u = 1, normal_v = 0, nearest = 1e9f;

  void Meet(float distance, float nu, float nv) {
    any = true;
    if (distance < nearest) {
      nearest = distance;
      normal_u = nu;
      normal_v = nv;
    }
  }
};

TargetPattern::TargetPattern(const SceneTarget& target)
    : sticker_(static_cast<float>(target.sticker_mm / target.radius_mm)),
      square_(target.sticker == StickerShape::kSquare),
      num_bits_(target.num_bits),
      code_(target.code) {
  if (num_bits_ == 0) return;
  inner_ = static_cast<float>(target.ring[0]);
  outer_ = static_cast<float>(target.ring[1]);
  for (int k = 0; k < num_bits_; ++k) {
    const double angle = 2 * std::numbers::pi * k / num_bits_;
    cos_.push_back(static_cast<float>(std::cos(angle)));
    sin_.push_back(static_cast<float>(std::sin(angle)));
  }
}

int TargetPattern::SectorOf(float u, float v) const {
  const float turns = std::atan2(v, u) * static_cast<float>(0.5 / std::numbers::pi);
  const int sector = static_cast<int>(std::floor(turns * static_cast<float>(num_bits_)));
  return ((sector % num_bits_) + num_bits_) % num_bits_;
}

/// The borders nearer than `reach` to (u, v).
TargetPattern::Crossed TargetPattern::BordersOf(float u, float v, float reach) const {
  Crossed c;
  const float r = std::sqrt(u * u + v * v);
  const auto circle = [&](float radius, bool* flag) {
    const float distance = std::abs(r - radius);
    if (distance > reach) return;
    *flag = true;
    c.Meet(distance, u, v);
  };
  circle(1.0f, &c.dot);
  if (square_) {
    const float du = std::abs(std::abs(u) - sticker_), dv = std::abs(std::abs(v) - sticker_);
    if (du <= reach) c.sticker = true, c.Meet(du, 1, 0);
    if (dv <= reach) c.sticker = true, c.Meet(dv, 0, 1);
  } else {
    circle(sticker_, &c.sticker);
  }
  if (num_bits_ == 0 || r + reach < inner_ || r - reach > outer_) return c;
  circle(inner_, &c.inner);
  circle(outer_, &c.outer);
  const float n = static_cast<float>(num_bits_);
  const float place = std::atan2(v, u) * static_cast<float>(0.5 / std::numbers::pi) * n;
  c.sector = static_cast<int>(std::floor(place));
  // A chord of half length `reach` at r spans asin(reach / r) <= pi/2 reach / r.
  const float width = r > reach ? 0.25f * n * reach / r : n;
  c.general = width > 0.25f * n;
  c.first = c.general ? 0 : static_cast<int>(std::ceil(place - width));
  c.last = c.general ? num_bits_ - 1 : static_cast<int>(std::floor(place + width));
  for (int k = c.first; k <= c.last; ++k) {
    const int b = ((k % num_bits_) + num_bits_) % num_bits_;
    if (Bright(b) == Bright((b + num_bits_ - 1) % num_bits_)) continue;
    c.Meet(std::abs(cos_[b] * v - sin_[b] * u), -sin_[b], cos_[b]);
  }
  return c;
}

Coverage TargetPattern::At(float u, float v, const Crossed& crossed) const {
  const float r2 = u * u + v * v;
  const bool inside =
      square_ ? std::abs(u) <= sticker_ && std::abs(v) <= sticker_ : r2 <= sticker_ * sticker_;
  if (!inside) return {};
  if (r2 <= 1) return {1.0f, 1.0f};
  if (num_bits_ == 0 || r2 < inner_ * inner_ || r2 > outer_ * outer_) return {1.0f, 0.0f};
  int sector = crossed.sector;
  if (crossed.general) {
    sector = SectorOf(u, v);
  } else if (crossed.first <= crossed.last) {
    sector = crossed.first - 1;
    for (int k = crossed.first; k <= crossed.last; ++k) {
      const int b = ((k % num_bits_) + num_bits_) % num_bits_;
      if (cos_[b] * v - sin_[b] * u >= 0) sector = k;
    }
  }
  sector = ((sector % num_bits_) + num_bits_) % num_bits_;
  return {1.0f, Bright(sector) ? 1.0f : 0.0f};
}

/// Where the line (u, v) + t (du, dv), 0 < t < 1, crosses the borders.
void TargetPattern::AddCuts(float u, float v, float du, float dv, const Crossed& crossed,
                            Cuts* cuts) const {
  if (crossed.dot) cuts->AddCircle(u, v, du, dv, 1.0f);
  if (crossed.inner) cuts->AddCircle(u, v, du, dv, inner_);
  if (crossed.outer) cuts->AddCircle(u, v, du, dv, outer_);
  if (crossed.sticker && !square_) cuts->AddCircle(u, v, du, dv, sticker_);
  if (crossed.sticker && square_) {
    for (const float side : {-sticker_, sticker_}) {
      if (du != 0) cuts->Add((side - u) / du);
      if (dv != 0) cuts->Add((side - v) / dv);
    }
  }
  for (int k = crossed.first; k <= crossed.last; ++k) {
    const int b = ((k % num_bits_) + num_bits_) % num_bits_;
    const float slope = cos_[b] * dv - sin_[b] * du;
    if (slope != 0) cuts->Add((sin_[b] * u - cos_[b] * v) / slope);
  }
}

Coverage TargetPattern::CutByLines(const CellCorners& cell, const Crossed& crossed,
                                   int lines) const {
  // The normal's pull along x and along y of the picture: the lines run along the larger.
  const float along_x = crossed.normal_u * (cell.u10 - cell.u00 + cell.u11 - cell.u01) +
                        crossed.normal_v * (cell.v10 - cell.v00 + cell.v11 - cell.v01);
  const float along_y = crossed.normal_u * (cell.u01 - cell.u00 + cell.u11 - cell.u10) +
                        crossed.normal_v * (cell.v01 - cell.v00 + cell.v11 - cell.v10);
  const bool rows = std::abs(along_x) >= std::abs(along_y);
  Coverage sum;
  float sticker_along = 0, sticker_across = 0, mark_along = 0, mark_across = 0;
  for (int line = 0; line < lines; ++line) {
    const float s = (static_cast<float>(line) + 0.5f) / static_cast<float>(lines);
    const float u0 = cell.u00 + s * ((rows ? cell.u01 : cell.u10) - cell.u00);
    const float v0 = cell.v00 + s * ((rows ? cell.v01 : cell.v10) - cell.v00);
    const float other_u = rows ? cell.u10 : cell.u01, other_v = rows ? cell.v10 : cell.v01;
    const float du = other_u + s * (cell.u11 - other_u) - u0;
    const float dv = other_v + s * (cell.v11 - other_v) - v0;
    Cuts cuts;
    AddCuts(u0, v0, du, dv, crossed, &cuts);
    std::sort(cuts.at.begin(), cuts.at.begin() + cuts.count);
    cuts.at[cuts.count] = 1.0f;
    float begin = 0;
    for (int k = 0; k <= cuts.count; ++k) {
      const float length = cuts.at[k] - begin, middle = 0.5f * (cuts.at[k] + begin);
      const Coverage here = At(u0 + middle * du, v0 + middle * dv, crossed);
      sum.sticker += length * here.sticker;
      sum.mark += length * here.mark;
      sticker_along += length * (middle - 0.5f) * here.sticker;
      mark_along += length * (middle - 0.5f) * here.mark;
      sticker_across += length * (s - 0.5f) * here.sticker;
      mark_across += length * (s - 0.5f) * here.mark;
      begin = cuts.at[k];
    }
  }
  const float share = 1.0f / static_cast<float>(lines);
  return {sum.sticker * share,
          sum.mark * share,
          true,
          share * (rows ? sticker_along : sticker_across),
          share * (rows ? sticker_across : sticker_along),
          share * (rows ? mark_along : mark_across),
          share * (rows ? mark_across : mark_along)};
}

Coverage TargetPattern::Over(const CellCorners& cell, int lines) const {
  const float u = 0.25f * (cell.u00 + cell.u10 + cell.u01 + cell.u11);
  const float v = 0.25f * (cell.v00 + cell.v10 + cell.v01 + cell.v11);
  const float d1 =
      (cell.u00 - cell.u11) * (cell.u00 - cell.u11) + (cell.v00 - cell.v11) * (cell.v00 - cell.v11);
  const float d2 =
      (cell.u10 - cell.u01) * (cell.u10 - cell.u01) + (cell.v10 - cell.v01) * (cell.v10 - cell.v01);
  // Half the longer diagonal, a little more where the cell is no parallelogram.
  const float reach = 0.51f * std::sqrt(std::max(d1, d2));
  const float far = sticker_ + reach;
  if (!(std::abs(u) <= far && std::abs(v) <= far)) return {};
  const Crossed crossed = BordersOf(u, v, reach);
  return crossed.any ? CutByLines(cell, crossed, lines) : At(u, v, crossed);
}

}  // namespace videogrammetry
