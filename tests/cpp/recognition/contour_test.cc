#include "videogrammetry/recognition/contour.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace videogrammetry {
namespace {

constexpr int kSize = 64;

std::vector<std::uint8_t> Blank() { return std::vector<std::uint8_t>(kSize * kSize, 0); }

std::uint8_t& At(std::vector<std::uint8_t>& pixels, int x, int y) {
  return pixels[static_cast<std::size_t>(y * kSize + x)];
}

TEST(ContourTest, MomentsEqualSumsOverPixels) {
  auto pixels = Blank();
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;
  int first_x = -1, first_y = -1;
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const double u = x - 30.3, v = y - 28.6, p = u + 0.4 * v;
      if (p * p / 300 + v * v / 120 > 1) continue;
      At(pixels, x, y) = 200;
      n += 1;
      sx += x;
      sy += y;
      sxx += x * x;
      sxy += x * y;
      syy += y * y;
      if (y == 28 && first_x < 0) {
        first_x = x;
        first_y = y;
      }
    }
  }
  const ImageView8 view(pixels.data(), kSize, kSize);
  const SignedImage<std::uint8_t> image(view, 1);
  ContourFollower<std::uint8_t> follower(image, 60);
  ASSERT_EQ(follower.Follow(first_x, first_y, 100), ContourEnd::kClosed);
  const ContourMoments m = follower.Moments();
  EXPECT_NEAR(m.area, n, 1e-9);
  EXPECT_NEAR(m.mean_x, sx / n, 1e-9);
  EXPECT_NEAR(m.mean_y, sy / n, 1e-9);
  EXPECT_NEAR(m.var_xx, sxx / n - sx * sx / n / n, 1e-6);
  EXPECT_NEAR(m.var_xy, sxy / n - sx * sy / n / n, 1e-6);
  EXPECT_NEAR(m.var_yy, syy / n - sy * sy / n / n, 1e-6);
  // The pixels' staircase over this area: likeness is 1 to some tenths of a percent.
  EXPECT_NEAR(EllipseLikeness(m), 1.0, 5e-3);
}

TEST(ContourTest, SquareIsLessLikeAnEllipse) {
  auto pixels = Blank();
  for (int y = 20; y < 40; ++y) {
    for (int x = 20; x < 40; ++x) At(pixels, x, y) = 200;
  }
  const ImageView8 view(pixels.data(), kSize, kSize);
  const SignedImage<std::uint8_t> image(view, 1);
  ContourFollower<std::uint8_t> follower(image, 60);
  ASSERT_EQ(follower.Follow(20, 30, 100), ContourEnd::kClosed);
  // A^2 = s^4, determinant (s^2 / 12)^2 with 1/12 taken off: 3 / pi s^2 / (s^2 - 1).
  EXPECT_NEAR(EllipseLikeness(follower.Moments()), 3.0 / std::numbers::pi * 400.0 / 399.0, 1e-9);
}

TEST(ContourTest, EndsWhereItMust) {
  auto pixels = Blank();
  for (int x = 5; x < 60; ++x) At(pixels, x, 30) = 200;  // long
  for (int y = 0; y < 6; ++y) {
    for (int x = 10; x < 16; ++x) At(pixels, x, y) = 200;  // touches the upper border
  }
  At(pixels, 40, 50) = 200;  // one pixel
  const ImageView8 view(pixels.data(), kSize, kSize);
  const SignedImage<std::uint8_t> image(view, 1);
  ContourFollower<std::uint8_t> follower(image, 20);
  EXPECT_EQ(follower.Follow(5, 30, 100), ContourEnd::kExceeds);
  EXPECT_EQ(follower.Follow(10, 3, 100), ContourEnd::kLeavesImage);
  ASSERT_EQ(follower.Follow(40, 50, 100), ContourEnd::kClosed);
  EXPECT_EQ(follower.Moments().area, 1.0);
  EXPECT_FALSE(EllipseFromMoments(follower.Moments()).has_value());
}

TEST(ContourTest, DarkRegionsOfANegatedPicture) {
  std::vector<std::uint8_t> pixels(kSize * kSize, 250);
  for (int y = 20; y < 30; ++y) {
    for (int x = 20; x < 30; ++x) At(pixels, x, y) = 10;
  }
  const ImageView8 view(pixels.data(), kSize, kSize);
  const SignedImage<std::uint8_t> image(view, -1);
  ContourFollower<std::uint8_t> follower(image, 60);
  ASSERT_EQ(follower.Follow(20, 25, -100), ContourEnd::kClosed);
  EXPECT_EQ(follower.Moments().area, 100.0);
}

}  // namespace
}  // namespace videogrammetry
