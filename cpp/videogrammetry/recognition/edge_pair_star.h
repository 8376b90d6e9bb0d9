#pragma once

// Private to the edge-pair search: what a bright area looks like from its middle.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "videogrammetry/recognition/edge_pair_samples.h"

namespace videogrammetry::edge_pair {

/// Values of a picture in one storage, without a call or a decision a sample.
template <Storage kStorage>
class Samples {
 public:
  explicit Samples(const SampleRows& rows)
      : data_(rows.data),
        stride_(rows.stride_bytes),
        width_(rows.width),
        height_(rows.height),
        flip_(rows.flip) {}

  int width() const { return width_; }
  int height() const { return height_; }

  /// Bytes from a row's begin to sample x, which is even.
  std::ptrdiff_t BytesTo(int x) const {
    return kStorage == kBytes ? x : kStorage == kWords ? 2 * x : x / 2 * 3;
  }

  int operator()(int x, int y) const { return FromRow(data_ + y * stride_, x); }

  /// Steps of (kDx, dy) from (x, y) to where the values fall below the level, between two
  /// pixels on a straight line; -1 if that is further than `steps`. The way lies in the
  /// picture.
  template <int kDx>
  float StepsToLevel(int x, int y, int dy, int level, int steps) const {
    const std::ptrdiff_t down = dy * stride_;
    const std::uint8_t* row = data_ + y * stride_;
    int inside = FromRow(row, x);
    for (int k = 1; k <= steps; ++k) {
      row += down;
      x += kDx;
      const int value = FromRow(row, x);
      if (value < level) {
        return static_cast<float>(k - 1) +
               static_cast<float>(inside - level) / static_cast<float>(inside - value);
      }
      inside = value;
    }
    return -1.0f;
  }

 private:
  int FromRow(const std::uint8_t* row, int x) const {
    if constexpr (kStorage == kBytes) {
      return row[x] ^ flip_;
    } else if constexpr (kStorage == kWords) {
      return reinterpret_cast<const std::uint16_t*>(row)[x] ^ flip_;
    } else {
      // Two bytes hold a sample: at 3 x / 2, from the upper or the lower half byte on.
      const std::uint8_t* b = row + (3 * x >> 1);
      const int odd = x & 1;
      if constexpr (kStorage == kPackedHighFirst) {
        return ((((b[0] << 8) | b[1]) >> (odd ? 0 : 4)) & 0xfff) ^ flip_;
      } else {
        return ((((b[1] << 8) | b[0]) >> (odd ? 4 : 0)) & 0xfff) ^ flip_;
      }
    }
  }

  const std::uint8_t* data_;
  std::ptrdiff_t stride_;
  int width_, height_, flip_;
};

/// An ellipse as n^T S n = 1 / r(n)^2 about its centre.
struct Star {
  float x = 0.0f, y = 0.0f;
  float sxx = 0.0f, sxy = 0.0f, syy = 0.0f;
};

/// Where a bright area ends in eight directions from its middle.
///
/// From (x, y) the way leads to the middle of the area's extent above and below, and
/// there to that of its extent to both sides. About this point an ellipse ends alike in
/// opposite directions, and its half diameters r obey
///
///     1 / r(0)^2 + 1 / r(90)^2 = 1 / r(45)^2 + 1 / r(135)^2 = tr S,          (1)
///
/// 1 and 2 for a square upright, 2 and 1 for one on its corner.
template <Storage kStorage>
class StarLook {
 public:
  /// @param least_diameter_px  what is thinner up and down or from side to side is none.
  StarLook(const Samples<kStorage>& samples, int max_extent_px, double least_diameter_px)
      : samples_(samples),
        max_extent_(max_extent_px),
        least_diameter_(static_cast<float>(least_diameter_px)) {}

  /// @param length_px  of a chord through (x, y) along the row.
  std::optional<Star> Look(int x, int y, int level, int length_px) const {
    if (samples_(x, y) < level) return std::nullopt;
    // Half of five times the chord: minor / major >= 0.2.
    int most = Most(length_px);
    // Of a slanted ellipse each turn goes a part of the way.
    for (int turn = 0;; ++turn) {
      Line upright = Along<0>(x, y, 1, level, most);
      if (IsNone(upright)) return std::nullopt;
      const int shift_y = upright.ToMiddle();
      y += shift_y;
      most = Most(static_cast<int>(upright.Length()) + 1);
      Line flat = Along<1>(x, y, 0, level, most);
      if (IsNone(flat)) return std::nullopt;
      const int shift_x = flat.ToMiddle();
      x += shift_x;
      most = std::max(most, Most(static_cast<int>(flat.Length()) + 1));
      const bool is_middle = turn > 0 && std::abs(shift_x) + std::abs(shift_y) < 2;
      if (shift_x != 0 && !is_middle && turn + 1 < kMostTurns) continue;
      if (shift_x != 0) upright = Along<0>(x, y, 1, level, most);
      return FromMiddle(x, y, level, most, flat, upright);
    }
  }

 private:
  /// Steps by which a half diameter may be longer than its opposite, and the part of their
  /// sum; and how far the sides of Eq. (1) may differ, as a part of their sum.
  static constexpr float kUnlikePx = 2.5f, kUnlike = 0.1f, kUneven = 0.18f, kUnevenPx = 0.4f;

  /// What one of two diameters is of the other at least: somewhat less than what the axes are.
  static constexpr float kThin = 0.16f;
  static constexpr int kMostTurns = 4;

  int Most(int length) const {
    return length < max_extent_ ? std::min(max_extent_, 5 * length / 2 + 4) : max_extent_;
  }

  /// Steps to where the values fall below the level on either side of a pixel, between
  /// two pixels on a straight line; -1 if that is further than wanted or beyond the picture.
  struct Line {
    float back = -1.0f, ahead = -1.0f;

    float Length() const { return back + ahead; }
    /// Goes to the middle. @return the steps.
    int ToMiddle() {
      const float steps = std::floor(0.5f * (ahead - back) + 0.5f);
      back += steps;
      ahead -= steps;
      return static_cast<int>(steps);
    }
  };

  bool IsNone(const Line& line) const {
    return line.back < 0.0f || line.Length() < least_diameter_;
  }

  template <int kDx>
  Line Along(int x, int y, int dy, int level, int most) const {
    Line line;
    line.back = Extent<-kDx>(x, y, -dy, level, most);
    if (line.back < 0.0f) return {};
    line.ahead = Extent<kDx>(x, y, dy, level, most);
    return line.ahead < 0.0f ? Line{} : line;
  }

  template <int kDx>
  float Extent(int x, int y, int dy, int level, int most) const {
    int steps = most + 1;
    if (kDx != 0) steps = std::min(steps, kDx > 0 ? samples_.width() - 1 - x : x);
    if (dy != 0) steps = std::min(steps, dy > 0 ? samples_.height() - 1 - y : y);
    return samples_.template StepsToLevel<kDx>(x, y, dy, level, steps);
  }

  struct Diameter {
    float half = -1.0f, middle = 0.0f;  ///< in steps
  };

  static Diameter Across(const Line& line) {
    const float sum = line.Length(), difference = line.ahead - line.back;
    if (line.back < 0.0f || std::abs(difference) > kUnlikePx + kUnlike * sum) return {};
    return {0.5f * sum, 0.5f * difference};
  }

  std::optional<Star> FromMiddle(int x, int y, int level, int most, const Line& across,
                                 const Line& up_down) const {
    const Diameter upright = Across(up_down);
    const Diameter flat = Across(across);
    const float thinner = std::min(flat.half, upright.half);
    const float longer = std::max(flat.half, upright.half);
    if (thinner < 0.5f || thinner < kThin * longer) return std::nullopt;
    const Diameter falling = Across(Along<1>(x, y, 1, level, most));
    if (falling.half < 0.35f) return std::nullopt;
    const Diameter rising = Across(Along<1>(x, y, -1, level, most));
    if (rising.half < 0.35f) return std::nullopt;
    const float f = 1.0f / (flat.half * flat.half), u = 1.0f / (upright.half * upright.half);
    const float d = 0.5f / (falling.half * falling.half), r = 0.5f / (rising.half * rising.half);
    const float least = std::min(std::min(flat.half, upright.half),
                                 1.41421356f * std::min(falling.half, rising.half));
    const float even = f + u, odd = d + r;
    if (std::abs(even - odd) > (kUneven + kUnevenPx / least) * (even + odd)) return std::nullopt;
    Star star;
    // Least squares of the four: each pair's sum is corrected by half the contradiction.
    const float half = 0.25f * (odd - even);
    star.sxx = f + half;
    star.syy = u + half;
    star.sxy = 0.5f * (d - r);
    MoveToCentre(x, y, {flat.middle, upright.middle, falling.middle, rising.middle}, &star);
    return star;
  }

  // A diameter along the step n through a point p has its middle t steps from p, with
  // n^T S (p - c + t n) = 0. Least squares of the four for c.
  static void MoveToCentre(int x, int y, const std::array<float, 4>& t, Star* star) {
    constexpr float kSteps[4][2] = {{1, 0}, {0, 1}, {1, 1}, {1, -1}};
    float xx = 0, xy = 0, yy = 0, rx = 0, ry = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      const float nx = kSteps[i][0], ny = kSteps[i][1];
      const float sx = star->sxx * nx + star->sxy * ny, sy = star->sxy * nx + star->syy * ny;
      const float along = sx * nx + sy * ny;
      if (!(along > 0.0f)) continue;
      const float ax = sx / along, ay = sy / along;
      xx += ax * ax;
      xy += ax * ay;
      yy += ay * ay;
      rx += ax * t[i];
      ry += ay * t[i];
    }
    const float det = xx * yy - xy * xy;
    star->x = static_cast<float>(x);
    star->y = static_cast<float>(y);
    if (!(det > 1e-6f)) return;
    star->x += (yy * rx - xy * ry) / det;
    star->y += (xx * ry - xy * rx) / det;
  }

  const Samples<kStorage>& samples_;
  const int max_extent_;
  const float least_diameter_;
};

}  // namespace videogrammetry::edge_pair
