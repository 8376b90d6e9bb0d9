#include "videogrammetry/rendering/target_pattern.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <numbers>

namespace videogrammetry {
namespace {

SceneTarget Coded(std::uint32_t code, int bits, StickerShape shape = StickerShape::kDisc) {
  SceneTarget target;
  target.radius_mm = 2;
  target.num_bits = bits;
  target.code = code;
  target.sticker_mm = 8;
  target.sticker = shape;
  return target;
}

/// Areas of the pattern, in radii^2, from cells of `size` over the whole sticker.
Coverage Areas(const SceneTarget& target, float size, int lines) {
  const TargetPattern pattern(target);
  double sticker = 0, mark = 0;
  const float c = std::cos(0.3f) * size, s = std::sin(0.3f) * size;  // cells turned by 0.3
  const int reach = static_cast<int>(7.0f / size);
  for (int j = -reach; j < reach; ++j) {
    for (int i = -reach; i < reach; ++i) {
      const auto u = [&](int a, int b) { return c * (i + a + 0.37f) - s * (j + b + 0.11f); };
      const auto v = [&](int a, int b) { return s * (i + a + 0.37f) + c * (j + b + 0.11f); };
      const Coverage cover = pattern.Over(
          {u(0, 0), v(0, 0), u(1, 0), v(1, 0), u(0, 1), v(0, 1), u(1, 1), v(1, 1)}, lines);
      sticker += cover.sticker;
      mark += cover.mark;
    }
  }
  return {static_cast<float>(sticker * size * size), static_cast<float>(mark * size * size)};
}

TEST(TargetPattern, AreasAreExact) {
  for (const float size : {0.05f, 0.12f, 0.4f}) {
    for (const std::uint32_t code : {0b10010110111u, 0b1u, 0x3fffu}) {
      const SceneTarget target = Coded(code, 14);
      const double share = std::popcount(code) / 14.0;
      const double mark = std::numbers::pi * (1 + (9 - 4) * share);
      const Coverage areas = Areas(target, size, 4);
      // A cell's error is below 1 / (8 * 4^2) of it where a border turns within the cell, of
      // any sign: over n crossed cells size^2 sqrt(n) / 128; n = perimeter / size < 100 / size.
      const double bound = size * size * std::sqrt(100 / size) / 128 + 2e-4;
      EXPECT_NEAR(areas.mark, mark, 4 * bound) << size << " " << code;
      EXPECT_NEAR(areas.sticker, std::numbers::pi * 16, 4 * bound) << size << " " << code;
    }
  }
}

TEST(TargetPattern, SquareSticker) {
  EXPECT_NEAR(Areas(Coded(5, 14, StickerShape::kSquare), 0.12f, 4).sticker, 64.0, 0.02);
}

TEST(TargetPattern, SectorsRunFromXTowardsY) {
  const TargetPattern pattern(Coded(0b1000, 4));  // the first sector alone is bright
  const auto at = [&](float u, float v) {
    return pattern.Over({u, v, u + 0.01f, v, u, v + 0.01f, u + 0.01f, v + 0.01f}, 4).mark;
  };
  EXPECT_EQ(at(1.8f, 1.8f), 1.0f);
  EXPECT_EQ(at(-1.8f, 1.8f), 0.0f);
  EXPECT_EQ(at(-1.8f, -1.8f), 0.0f);
  EXPECT_EQ(at(1.8f, -1.8f), 0.0f);
  EXPECT_EQ(at(0.5f, -0.5f), 1.0f);  // the dot
  EXPECT_EQ(at(1.5f, 0.1f), 0.0f);   // between dot and ring
}

TEST(TargetPattern, HalfACell) {
  const TargetPattern pattern(Coded(0b1000, 4));
  // A cell astride the sectors' border at u = 0, v = 2.5.
  const Coverage half = pattern.Over({-0.1f, 2.4f, 0.1f, 2.4f, -0.1f, 2.6f, 0.1f, 2.6f}, 4);
  EXPECT_NEAR(half.mark, 0.5, 1e-5);
  EXPECT_NEAR(half.sticker, 1.0, 1e-6);
}

}  // namespace
}  // namespace videogrammetry
