#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include "videogrammetry/recognition/bilinear.h"
#include "videogrammetry/recognition/gradient_mask.h"
#include "videogrammetry/recognition/grey_sampler.h"
#include "videogrammetry/recognition/grey_window.h"

namespace videogrammetry {
namespace {

constexpr InstructionSet kSets[] = {InstructionSet::kBaseline, InstructionSet::kAvx2,
                                    InstructionSet::kAvx512};

template <typename T>
class KernelsTest : public ::testing::Test {
 protected:
  static constexpr int kLargest = sizeof(T) == 1 ? 255 : 65535;

  static std::vector<T> Noise(std::size_t count, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_int_distribution<int> grey(0, kLargest);
    std::vector<T> values(count);
    for (T& value : values) value = static_cast<T>(grey(random));
    return values;
  }
};

using PixelTypes = ::testing::Types<std::uint8_t, std::uint16_t>;
TYPED_TEST_SUITE(KernelsTest, PixelTypes);

TYPED_TEST(KernelsTest, MaskIsTheDefinitionForEverySetWidthAndThreshold) {
  for (const InstructionSet set : kSets) {
    if (set > DetectInstructionSet()) continue;
    const auto mask = SelectGradientMask<TypeParam>(set);
    for (const int width : {1, 2, 3, 63, 64, 65, 66, 127, 128, 129, 130, 200, 1024, 1029}) {
      const auto row = this->Noise(static_cast<std::size_t>(width), static_cast<unsigned>(width));
      for (const int threshold : {0, 1, this->kLargest / 3, this->kLargest - 1, this->kLargest}) {
        const auto words = static_cast<std::size_t>(width + 63) / 64;
        std::vector<std::uint64_t> rises(words, ~0ull), falls(words, ~0ull);
        mask(row.data(), width, threshold, rises.data(), falls.data());
        for (int x = 0; x < static_cast<int>(64 * words); ++x) {
          int g = 0;
          if (x > 0 && x + 1 < width) {
            g = static_cast<int>(row[static_cast<std::size_t>(x + 1)]) -
                static_cast<int>(row[static_cast<std::size_t>(x - 1)]);
          }
          const auto word = static_cast<std::size_t>(x / 64);
          ASSERT_EQ((rises[word] >> (x % 64)) & 1, g > threshold ? 1u : 0u)
              << InstructionSetName(set) << ", width " << width << ", x " << x;
          ASSERT_EQ((falls[word] >> (x % 64)) & 1, g < -threshold ? 1u : 0u)
              << InstructionSetName(set) << ", width " << width << ", x " << x;
        }
      }
    }
  }
}

TYPED_TEST(KernelsTest, BilinearGivesTheSameBitsForEverySet) {
  constexpr int kWidth = 37, kHeight = 23, kStride = 41;
  const auto image = this->Noise(kStride * kHeight + 8, 7);
  std::mt19937 random(11);
  std::uniform_real_distribution<float> across(0.0f, kWidth - 1.01f - kBilinearMargin);
  std::uniform_real_distribution<float> down(0.0f, kHeight - 1.01f);
  for (const int count : {1, 7, 8, 9, 15, 16, 17, 100}) {
    const auto n = static_cast<std::size_t>(count);
    std::vector<float> x(n), y(n), expected(n);
    for (std::size_t k = 0; k < n; ++k) {
      x[k] = across(random);
      y[k] = down(random);
    }
    SelectBilinear<TypeParam>(InstructionSet::kBaseline)(image.data(), kStride, x.data(), y.data(),
                                                         count, expected.data());
    for (const InstructionSet set : kSets) {
      if (set > DetectInstructionSet()) continue;
      std::vector<float> out(n);
      SelectBilinear<TypeParam>(set)(image.data(), kStride, x.data(), y.data(), count, out.data());
      EXPECT_EQ(out, expected) << InstructionSetName(set) << ", count " << count;
    }
  }
}

TYPED_TEST(KernelsTest, BilinearIsExactOnAPlane) {
  constexpr int kStride = 16;
  std::vector<TypeParam> image(kStride * kStride);
  for (int i = 0; i < kStride * kStride; ++i) {
    image[static_cast<std::size_t>(i)] =
        static_cast<TypeParam>(10 + 3 * (i % kStride) + 5 * (i / kStride));
  }
  const std::vector<float> x = {0.0f, 1.25f, 7.5f, 11.75f}, y = {0.0f, 3.5f, 8.25f, 13.0f};
  std::vector<float> out(4);
  SelectBilinear<TypeParam>(DetectInstructionSet())(image.data(), kStride, x.data(), y.data(), 4,
                                                    out.data());
  // Quarters are exact in binary arithmetic.
  for (std::size_t k = 0; k < 4; ++k) EXPECT_EQ(out[k], 10 + 3 * x[k] + 5 * y[k]);
}

/// Samples of 12 bits, packed.
std::vector<std::uint8_t> Packed(const std::vector<std::uint16_t>& samples, PackedOrder order) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i < samples.size(); i += 2) {
    const int a = samples[i], b = samples[i + 1];
    const bool high = order == PackedOrder::kHighFirst;
    bytes.push_back(static_cast<std::uint8_t>(high ? a >> 4 : a & 255));
    bytes.push_back(
        static_cast<std::uint8_t>(high ? (a & 15) << 4 | b >> 8 : a >> 8 | (b & 15) << 4));
    bytes.push_back(static_cast<std::uint8_t>(high ? b & 255 : b >> 4));
  }
  return bytes;
}

TEST(GreySamplerTest, GivesTheSameBitsForEverySetAndDepthUpToThePicturesEnd) {
  constexpr int kWidth = 62, kHeight = 40;
  std::mt19937 random(5);
  std::uniform_int_distribution<int> grey(0, 255);
  std::vector<std::uint16_t> pixels(kWidth * kHeight);
  for (auto& pixel : pixels) pixel = static_cast<std::uint16_t>(grey(random));
  const std::vector<std::uint8_t> bytes(pixels.begin(), pixels.end());
  const auto high = Packed(pixels, PackedOrder::kHighFirst);
  const auto low = Packed(pixels, PackedOrder::kLowFirst);
  const FrameView frames[] = {ImageView16(pixels.data(), kWidth, kHeight),
                              ImageView8(bytes.data(), kWidth, kHeight),
                              Packed12View(high.data(), kWidth, kHeight, PackedOrder::kHighFirst),
                              Packed12View(low.data(), kWidth, kHeight, PackedOrder::kLowFirst)};
  constexpr int kLeft = 7, kTop = 3;
  for (const float bottom : {30.0f, 35.99f}) {  // the last row too
    std::uniform_real_distribution<float> across(0.0f, 53.9f), down(0.0f, bottom);
    for (const int count : {1, 7, 8, 9, 15, 16, 17, 100, 300}) {
      const auto n = static_cast<std::size_t>(count);
      std::vector<float> x(n), y(n), expected;
      for (std::size_t k = 0; k < n; ++k) x[k] = across(random), y[k] = down(random);
      for (const FrameView& frame : frames) {
        for (const InstructionSet set : kSets) {
          if (set > DetectInstructionSet()) continue;
          const GreySampler sampler(frame, -1, set);
          std::vector<float> out(n);
          sampler.Sample(kLeft, kTop, kTop + static_cast<int>(bottom) + 1, x.data(), y.data(),
                         count, out.data());
          if (expected.empty()) expected = out;
          EXPECT_EQ(out, expected) << InstructionSetName(set) << ", count " << count;
          EXPECT_EQ(sampler.At(kLeft + double{x[0]}, kTop + double{y[0]}), out[0]);
        }
      }
      // A rounding of 2^-24 of the largest value for each of a handful of operations.
      const int i = static_cast<int>(x[0]), j = static_cast<int>(y[0]);
      const double a = x[0] - i, b = y[0] - j;
      const auto at = [&](int u, int v) {
        return static_cast<double>(
            pixels[static_cast<std::size_t>((v + kTop) * kWidth + u + kLeft)]);
      };
      const double value = (1 - b) * ((1 - a) * at(i, j) + a * at(i + 1, j)) +
                           b * ((1 - a) * at(i, j + 1) + a * at(i + 1, j + 1));
      EXPECT_NEAR(expected[0], -value, 255.0 * 16 / (1 << 24));
    }
  }
}

TEST(WindowReaderTest, WindowsHoldTheSamplesOfEveryDepth) {
  constexpr int kWidth = 74, kHeight = 40;
  std::mt19937 random(5);
  std::uniform_int_distribution<int> grey(0, 4095);
  std::vector<std::uint16_t> pixels(kWidth * kHeight);
  for (auto& pixel : pixels) pixel = static_cast<std::uint16_t>(grey(random));
  const auto high = Packed(pixels, PackedOrder::kHighFirst);
  const auto low = Packed(pixels, PackedOrder::kLowFirst);
  const FrameView frames[] = {ImageView16(pixels.data(), kWidth, kHeight),
                              Packed12View(high.data(), kWidth, kHeight, PackedOrder::kHighFirst),
                              Packed12View(low.data(), kWidth, kHeight, PackedOrder::kLowFirst)};
  for (const FrameView& frame : frames) {
    for (const InstructionSet set : kSets) {
      if (set > DetectInstructionSet()) continue;
      WindowReader reader(frame, -1, set);
      // All places in a row, narrow and wide, up to the picture's last byte and beyond.
      for (const int y0 : {-2, 0, 11, kHeight - 3}) {
        for (int x0 = -3; x0 < kWidth; ++x0) {
          for (const int width : {1, 7, 16, 17, 33}) {
            reader.Prefetch(x0, y0, x0 + width - 1, y0 + 4);
            const GreyWindow window = reader.Read(x0, y0, x0 + width - 1, y0 + 4);
            for (int y = std::max(0, y0); y < std::min(kHeight, y0 + 5); ++y) {
              for (int x = std::max(0, x0); x < std::min(kWidth, x0 + width); ++x) {
                ASSERT_EQ(window(x, y),
                          -static_cast<float>(pixels[static_cast<std::size_t>(y * kWidth + x)]))
                    << x << " " << y << " " << InstructionSetName(set);
              }
            }
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace videogrammetry
