#include "videogrammetry/geometry/remap.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

namespace videogrammetry {
namespace {

constexpr int kWidth = 40, kHeight = 30;
constexpr Interpolation kAll[] = {Interpolation::kLinear, Interpolation::kCubic,
                                  Interpolation::kLanczos};

std::vector<std::uint16_t> Picture(const std::function<double(double, double)>& grey) {
  std::vector<std::uint16_t> picture;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      picture.push_back(static_cast<std::uint16_t>(std::lround(grey(x, y))));
    }
  }
  return picture;
}

std::uint16_t At(const std::vector<std::uint16_t>& picture, double x, double y,
                 RemapOptions options) {
  const double place[] = {x, y};
  std::uint16_t value = 0;
  Remap(ImageView16(picture.data(), kWidth, kHeight), place, 1, 1, options, &value);
  return value;
}

TEST(Remap, PixelsThemselvesComeBack) {
  const auto picture = Picture([](double x, double y) { return 997 * x + 31 * y * y; });
  std::vector<double> map;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) map.insert(map.end(), {1.0 * x, 1.0 * y});
  }
  for (const Interpolation interpolation : kAll) {
    for (const int threads : {1, 3}) {
      std::vector<std::uint16_t> out(picture.size(), 1);
      Remap(ImageView16(picture.data(), kWidth, kHeight), map.data(), kWidth, kHeight,
            {.interpolation = interpolation, .num_threads = threads}, out.data());
      EXPECT_EQ(out, picture) << static_cast<int>(interpolation);
    }
  }
}

TEST(Remap, PolynomialsThatTheKernelHoldsAreExact) {
  // Integer coefficients with even steps: samples are whole, so that only the result's own
  // rounding, half a grey level, remains.
  const auto plane = [](double x, double y) { return 500 + 800 * x + 300 * y; };
  const auto curved = [](double x, double y) { return 500 + 20 * x * x + 16 * y * y + 4 * x * y; };
  for (const auto& [x, y] : {std::pair{7.3, 11.9}, std::pair{20.5, 15.5}, std::pair{30.01, 3.7}}) {
    EXPECT_NEAR(At(Picture(plane), x, y, {.interpolation = Interpolation::kLinear}), plane(x, y),
                0.51);
    EXPECT_NEAR(At(Picture(plane), x, y, {.interpolation = Interpolation::kLanczos}), plane(x, y),
                0.51);
    const RemapOptions cubic{.interpolation = Interpolation::kCubic};
    EXPECT_NEAR(At(Picture(plane), x, y, cubic), plane(x, y), 0.51);
    EXPECT_NEAR(At(Picture(curved), x, y, cubic), curved(x, y), 0.51);
  }
}

TEST(Remap, WaveOfTwelvePixelsByTheBetterKernels) {
  const auto wave = [](double x, double y) {
    return 20000 + 10000 * std::sin(2 * M_PI * (x + 0.3 * y) / 12);
  };
  const auto picture = Picture(wave);
  double worst[3] = {0, 0, 0};
  for (double x = 10; x < 25; x += 0.37) {
    for (const Interpolation kernel : kAll) {
      const double error = At(picture, x, 12.6, {.interpolation = kernel}) - wave(x, 12.6);
      double& most = worst[static_cast<int>(kernel)];
      most = std::max(most, std::abs(error));
    }
  }
  // Errors of the middle between samples: linear 1 - cos(w/2) = w^2/8 of the amplitude
  // with w = 2 pi / 12 across (0.034) and 0.3 w down; Keys' cubic 3 w^4/128 (0.0018);
  // Lanczos-3 of such a long wave below 0.005.
  EXPECT_GT(worst[0], 300);
  EXPECT_LT(worst[0], 400);
  EXPECT_LT(worst[1], 25);
  EXPECT_LT(worst[2], 60);
}

TEST(Remap, BorderAndBeyond) {
  const auto picture = Picture([](double, double) { return 700; });
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Interpolation kernel : kAll) {
    const RemapOptions options{.interpolation = kernel, .fill = 9};
    // The outermost samples stand for those beyond the border.
    EXPECT_EQ(At(picture, -0.5, -0.5, options), 700);
    EXPECT_EQ(At(picture, kWidth - 0.51, kHeight - 0.51, options), 700);
    EXPECT_EQ(At(picture, -0.51, 5, options), 9);
    EXPECT_EQ(At(picture, kWidth - 0.5, 5, options), 9);
    EXPECT_EQ(At(picture, 5, kHeight - 0.5, options), 9);
    EXPECT_EQ(At(picture, nan, 5, options), 9);
    EXPECT_EQ(At(picture, 5, nan, options), 9);
    EXPECT_EQ(At(picture, 1e300, 5, options), 9);
  }
}

TEST(Remap, OvershootStaysWithinTheSamples) {
  const auto edge = Picture([](double x, double) { return x < 20 ? 0 : 4095; });
  for (const Interpolation kernel : {Interpolation::kCubic, Interpolation::kLanczos}) {
    EXPECT_EQ(At(edge, 20.5, 10, {.interpolation = kernel, .largest = 4095}), 4095);
    EXPECT_GT(At(edge, 20.5, 10, {.interpolation = kernel}), 4095);
    EXPECT_EQ(At(edge, 18.5, 10, {.interpolation = kernel}), 0);
  }
}

TEST(Remap, WrongGreyValuesAndEmptyPicturesAreNamed) {
  const std::uint8_t sample = 7;
  const double place[] = {0, 0};
  std::uint8_t out = 0;
  const ImageView8 one(&sample, 1, 1);
  EXPECT_THROW(Remap(one, place, 1, 1, {.largest = 256}, &out), std::invalid_argument);
  EXPECT_THROW(Remap(one, place, 1, 1, {.fill = -1, .largest = 255}, &out), std::invalid_argument);
  EXPECT_THROW(Remap(ImageView8(), place, 1, 1, {.largest = 255}, &out), std::invalid_argument);
  Remap(one, place, 1, 1, {.largest = 255}, &out);
  EXPECT_EQ(out, 7);
}

}  // namespace
}  // namespace videogrammetry
