#include "videogrammetry/rendering/sensor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace videogrammetry {
namespace {

constexpr double kFirst[] = {0.2595682, 1.1872412, -0.3398850};

TEST(StandardNormal, Moments) {
  for (const std::uint64_t seed : {1u, 2u, 77u}) {
    constexpr int kCount = 400000;
    double sum = 0, squares = 0, fourth = 0, neighbours = 0, before = 0;
    for (int i = 0; i < kCount; ++i) {
      const double n = StandardNormal(seed, i);
      sum += n;
      squares += n * n;
      fourth += n * n * n * n;
      neighbours += n * before;
      before = n;
    }
    // Standard errors 1, sqrt 2, sqrt 96 and 1 over sqrt(count); five of them.
    const double unit = 5 / std::sqrt(static_cast<double>(kCount));
    EXPECT_NEAR(sum / kCount, 0, unit) << seed;
    EXPECT_NEAR(squares / kCount, 1, unit * std::sqrt(2)) << seed;
    EXPECT_NEAR(fourth / kCount, 3, unit * std::sqrt(96)) << seed;
    EXPECT_NEAR(neighbours / kCount, 0, unit) << seed;
  }
}

TEST(StandardNormal, FirstNumbersOfASeedStay) {
  // Held by all machines and versions: pictures of old seeds stay the same.
  const std::vector<double> first = {StandardNormal(7, 0), StandardNormal(7, 1),
                                     StandardNormal(7, 1000000)};
  EXPECT_NEAR(first[0], kFirst[0], 1e-5);
  EXPECT_NEAR(first[1], kFirst[1], 1e-5);
  EXPECT_NEAR(first[2], kFirst[2], 1e-5);
}

TEST(ReadOut, NoiseHasTheStatedVariance) {
  Sensor sensor;
  sensor.bit_depth = 12;
  sensor.read_noise = 6;
  sensor.shot_noise_gain = 0.25;
  constexpr std::size_t kCount = 200000;
  for (const float level : {0.1f, 0.5f}) {
    const std::vector<float> light(kCount, level);
    std::vector<std::uint16_t> samples(kCount);
    ReadOut(light.data(), kCount, sensor, 5, samples.data());
    const double grey = level * 4095;
    const double variance = 36 + 0.25 * grey + 1.0 / 12;  // and rounding
    double sum = 0, squares = 0;
    for (const auto s : samples) sum += s - grey, squares += (s - grey) * (s - grey);
    EXPECT_NEAR(sum / kCount, 0, 5 * std::sqrt(variance / kCount));
    EXPECT_NEAR(squares / kCount / variance, 1, 5 * std::sqrt(2.0 / kCount));
  }
}

TEST(ReadOut, DepthsSaturate) {
  const std::vector<float> light = {-0.5f, 0.0f, 0.5f, 1.0f, 1.7f};
  for (const int depth : {10, 12, 14, 16}) {
    Sensor sensor;
    sensor.bit_depth = depth;
    std::vector<std::uint16_t> samples(light.size());
    ReadOut(light.data(), light.size(), sensor, 0, samples.data());
    const int full = (1 << depth) - 1;
    EXPECT_EQ(samples[0], 0);
    EXPECT_EQ(samples[1], 0);
    EXPECT_NEAR(samples[2], 0.5 * full, 0.51);
    EXPECT_EQ(samples[3], full);
    EXPECT_EQ(samples[4], full);
  }
}

}  // namespace
}  // namespace videogrammetry
