// Pictures that nobody meant to measure, by every method and estimator there is.
#include <gtest/gtest.h>

#include <functional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "videogrammetry/recognition/recognize.h"

namespace videogrammetry {
namespace {

/// Those of the known ones that this build has.
std::vector<std::string> Methods() {
  std::vector<std::string> methods;
  for (const char* method : {"local-canny", "edge-pair"}) {
    RecognitionOptions options;
    options.method = method;
    try {
      options.Check();
      methods.emplace_back(method);
    } catch (const std::invalid_argument&) {
      continue;
    }
  }
  return methods;
}

std::vector<RecognitionOptions> AllOptions() {
  std::vector<RecognitionOptions> all;
  for (const std::string& method : Methods()) {
    for (const auto polarity : {Polarity::kWhiteOnBlack, Polarity::kBlackOnWhite}) {
      for (const auto estimator :
           {Estimator::kMeanGradient, Estimator::kDualConic, Estimator::kModel}) {
        RecognitionOptions options;
        options.method = method;
        options.polarity = polarity;
        options.estimator = estimator;
        all.push_back(options);
      }
    }
  }
  return all;
}

using Grey = std::function<int(int, int)>;

/// The picture as 8 bit, 16 bit in distant rows, and, of an even width, packed.
struct Depths {
  std::vector<std::uint8_t> eight, packed;
  std::vector<std::uint16_t> sixteen;
  std::vector<FrameView> frames;

  Depths(int width, int height, const Grey& grey) {
    constexpr int kGap = 5;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        eight.push_back(static_cast<std::uint8_t>(grey(x, y) >> 4));
        sixteen.push_back(static_cast<std::uint16_t>(grey(x, y)));
        if (x % 2 == 1) {
          const int a = grey(x - 1, y), b = grey(x, y);
          packed.push_back(static_cast<std::uint8_t>(a >> 4));
          packed.push_back(static_cast<std::uint8_t>((a & 15) << 4 | b >> 8));
          packed.push_back(static_cast<std::uint8_t>(b));
        }
      }
      if (y + 1 < height) sixteen.insert(sixteen.end(), kGap, 4095);
    }
    frames.emplace_back(ImageView8(eight.data(), width, height));
    frames.emplace_back(ImageView16(sixteen.data(), width, height, width + kGap));
    if (width % 2 == 0) {
      frames.emplace_back(Packed12View(packed.data(), width, height, PackedOrder::kHighFirst));
    }
  }
};

void ExpectNothing(const std::string& name, int width, int height, const Grey& grey) {
  const Depths depths(width, height, grey);
  const CodeFamily family = SchneiderFamily(14);
  for (const RecognitionOptions& options : AllOptions()) {
    for (const FrameView& frame : depths.frames) {
      EXPECT_TRUE(Recognize(frame, options, family).empty())
          << name << " " << width << " x " << height << ", " << options.method << ", format "
          << frame.index();
    }
  }
}

TEST(BadInputTest, EvenPicturesHaveNoTargets) {
  for (const int grey : {0, 2047, 4095}) {
    ExpectNothing("even", 160, 120, [grey](int, int) { return grey; });
  }
}

TEST(BadInputTest, PatternsWithoutDotsHaveNoTargets) {
  for (const int cell : {1, 8}) {
    ExpectNothing("checkerboard", 160, 120,
                  [cell](int x, int y) { return 4095 * ((x / cell + y / cell) % 2); });
  }
  ExpectNothing("columns", 160, 120, [](int x, int) { return 4095 * (x % 2); });
  ExpectNothing("rows", 160, 120, [](int, int y) { return 4095 * (y % 2); });
  ExpectNothing("ramp", 160, 120, [](int x, int) { return 25 * x; });
  ExpectNothing("one pixel", 160, 120, [](int x, int y) { return x == 80 && y == 60 ? 4095 : 0; });
}

TEST(BadInputTest, PicturesWithoutRoomHaveNoTargets) {
  std::mt19937 random(7);
  const Grey noise = [&random](int, int) { return static_cast<int>(random() % 4096); };
  for (const auto& [width, height] : {std::pair{0, 0},
                                      {0, 9},
                                      {8, 0},
                                      {1, 1},
                                      {2, 1},
                                      {1, 2},
                                      {2000, 1},
                                      {1, 2000},
                                      {2000, 2},
                                      {2, 2000},
                                      {3, 3},
                                      {4, 300},
                                      {300, 4},
                                      {7, 7},
                                      {64, 5},
                                      {65, 5},
                                      {66, 5}}) {
    ExpectNothing("noise", width, height, noise);
  }
  for (const RecognitionOptions& options : AllOptions()) {
    EXPECT_TRUE(Recognize(FrameView(), options, SchneiderFamily(14)).empty());
  }
}

TEST(BadInputTest, NoiseHasHardlyATarget) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    std::mt19937 random(seed);
    const Depths uniform(400, 300, [&](int, int) { return static_cast<int>(random() % 4096); });
    const Depths salt(400, 300, [&](int, int) { return random() % 50 == 0 ? 4095 : 0; });
    for (const RecognitionOptions& options : AllOptions()) {
      for (const Depths* depths : {&uniform, &salt}) {
        for (const FrameView& frame : depths->frames) {
          const auto targets = Recognize(frame, options, SchneiderFamily(14));
          EXPECT_LE(targets.size(), 3u) << options.method << " seed " << seed;
          for (const Target& target : targets) EXPECT_FALSE(target.ring.id);
        }
      }
    }
  }
}

TEST(BadInputTest, WrongOptionsAreRefusedByName) {
  const std::vector<std::uint8_t> pixels(64, 0);
  const ImageView8 view(pixels.data(), 8, 8);
  RecognitionOptions options;
  options.method = "nothing";
  EXPECT_THROW(Recognize(view, options, SchneiderFamily(14)), std::invalid_argument);
  options = {};
  for (const std::array<double, 2> wrong : {std::array{2.0, 9.0},
                                            {9.0, 9.0},
                                            {9.0, 5.0},
                                            {5.0, 2001.0},
                                            {5.0, std::nan("")},
                                            {std::nan(""), 9.0},
                                            {-5.0, 9.0}}) {
    options.diameter_px = wrong;
    EXPECT_THROW(Recognize(view, options, SchneiderFamily(14)), std::invalid_argument);
  }
}

}  // namespace
}  // namespace videogrammetry
