#include "videogrammetry/recognition/recognize.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

#include "synthetic_picture.h"

namespace videogrammetry {
namespace {

using testing::Bits;
using testing::Drawn;
using testing::Picture;
using testing::Render;

const CodeFamily& Schneider() {
  static const CodeFamily family = SchneiderFamily(14);
  return family;
}

template <typename T>
std::vector<Target> RecognizeIn(const Picture<T>& picture, RecognitionOptions options = {}) {
  return Recognize(picture.view(), options, Schneider());
}

std::vector<Drawn> ThreeTargets() {
  return {{{60.3, 70.8, 9.0, 7.0, 0.5}, Bits(Schneider().codes[99], 14), 0.7},
          {{150.6, 60.2, 8.0, 8.0, 0.0}, {}, 0.0},
          {{140.4, 150.1, 12.0, 9.5, 2.5}, Bits(Schneider().codes[400], 14), 2.0}};
}

const Target* Nearest(const std::vector<Target>& targets, const Ellipse& e) {
  for (const Target& t : targets) {
    if (std::hypot(t.edge.ellipse.x_px - e.x_px, t.edge.ellipse.y_px - e.y_px) < 1.0) return &t;
  }
  return nullptr;
}

TEST(RecognizeTest, FindsAndReadsTargets) {
  const auto shapes = ThreeTargets();
  const auto targets = RecognizeIn(Render(220, 200, shapes));
  ASSERT_EQ(targets.size(), 3u);
  const std::optional<int> ids[3] = {100, std::nullopt, 401};
  for (std::size_t i = 0; i < 3; ++i) {
    const Target* target = Nearest(targets, shapes[i].ellipse);
    ASSERT_NE(target, nullptr);
    EXPECT_EQ(target->ring.id, ids[i]);
    // The drawing's 8 x 8 points place an edge to 1/16 px at single places;
    // around a contour of 40 independent ones that is 0.01 px.
    EXPECT_NEAR(target->edge.ellipse.x_px, shapes[i].ellipse.x_px, 0.01);
    EXPECT_NEAR(target->edge.ellipse.y_px, shapes[i].ellipse.y_px, 0.01);
    EXPECT_NEAR(target->edge.ellipse.semi_major_px, shapes[i].ellipse.semi_major_px, 0.03);
    EXPECT_NEAR(target->edge.ellipse.semi_minor_px, shapes[i].ellipse.semi_minor_px, 0.03);
    EXPECT_NEAR(target->edge.inside - target->edge.outside, 2700, 30);
  }
}

TEST(RecognizeTest, DarkTargetsOnBrightGround) {
  auto picture = Render(220, 200, ThreeTargets());
  for (auto& pixel : picture.pixels) pixel = static_cast<std::uint16_t>(3300 - pixel);
  RecognitionOptions options;
  options.polarity = Polarity::kBlackOnWhite;
  const auto negative = RecognizeIn(picture, options);
  const auto positive = RecognizeIn(Render(220, 200, ThreeTargets()));
  ASSERT_EQ(negative.size(), positive.size());
  for (std::size_t i = 0; i < negative.size(); ++i) {
    EXPECT_EQ(negative[i].ring.id, positive[i].ring.id);
    // Light is taken to multiply, so the ground's brightness weighs differently in the two.
    // An edge pixel of 64 points is off by 1 / (64 sqrt(12)) of the contrast, its edge by
    // twice that, the mean of some ten by 3e-3 px at most.
    EXPECT_NEAR(negative[i].edge.ellipse.x_px, positive[i].edge.ellipse.x_px, 5e-3);
  }
}

TEST(RecognizeTest, RowsMayLieApart) {
  const auto picture = Render(220, 200, ThreeTargets());
  std::vector<std::uint16_t> wide(300 * 200, 65535);
  for (int y = 0; y < 200; ++y) {
    for (int x = 0; x < 220; ++x) {
      wide[static_cast<std::size_t>(y * 300 + x)] =
          picture.pixels[static_cast<std::size_t>(y * 220 + x)];
    }
  }
  const auto apart =
      Recognize(ImageView16(wide.data(), 220, 200, 300), RecognitionOptions{}, Schneider());
  const auto dense = RecognizeIn(picture);
  ASSERT_EQ(apart.size(), dense.size());
  for (std::size_t i = 0; i < apart.size(); ++i) {
    EXPECT_EQ(apart[i].edge.ellipse.x_px, dense[i].edge.ellipse.x_px);
  }
}

TEST(RecognizeTest, CutByTheBorderIsNotMeasured) {
  const std::vector<Drawn> shapes = {{{3.0, 50.0, 8.0, 8.0, 0.0}, {}, 0.0},
                                     {{50.0, 96.0, 8.0, 8.0, 0.0}, {}, 0.0}};
  EXPECT_TRUE(RecognizeIn(Render(100, 100, shapes)).empty());
}

TEST(RecognizeTest, SameIdTwiceIsMarkedAtBoth) {
  auto shapes = ThreeTargets();
  shapes[2].bits = shapes[0].bits;
  const auto targets = RecognizeIn(Render(220, 200, shapes));
  ASSERT_EQ(targets.size(), 3u);
  for (const std::size_t i : {std::size_t{0}, std::size_t{2}}) {
    const Target* target = Nearest(targets, shapes[i].ellipse);
    ASSERT_NE(target, nullptr);
    EXPECT_EQ(target->ring.id, Nearest(targets, shapes[0].ellipse)->ring.id);
    EXPECT_TRUE(target->ring.id.has_value());
    EXPECT_EQ(target->ring.status, RingStatus::kDuplicate);
  }
}

TEST(RecognizeTest, HalfADotIsNone) {
  auto picture = Render(100, 100, {{{50.0, 50.0, 12.0, 12.0, 0.0}, {}, 0.0}});
  for (int y = 0; y < 100; ++y) {
    for (int x = 53; x < 100; ++x) picture.pixels[static_cast<std::size_t>(y * 100 + x)] = 300;
  }
  EXPECT_TRUE(RecognizeIn(picture).empty());
}

TEST(RecognizeTest, PicturesWithoutTargetsGiveNone) {
  for (const int size : {0, 1, 2, 3, 5, 50}) {
    const std::vector<std::uint8_t> pixels(static_cast<std::size_t>(size * size), 77);
    EXPECT_TRUE(Recognize(ImageView8(pixels.data(), size, size), RecognitionOptions{}, Schneider())
                    .empty());
  }
  for (const auto& [width, height] : {std::pair{1000, 1}, {1, 1000}, {1000, 2}}) {
    const std::vector<std::uint8_t> pixels(1000 * 2, 200);
    EXPECT_TRUE(
        Recognize(ImageView8(pixels.data(), width, height), RecognitionOptions{}, Schneider())
            .empty());
  }
}

TEST(RecognizeTest, NoiseAndCheckerboardsGiveNoIds) {
  std::mt19937 random(5);
  std::uniform_int_distribution<int> grey(0, 255);
  for (const int square : {0, 1, 3, 8, 20}) {
    std::vector<std::uint8_t> pixels(400 * 400);
    for (int i = 0; i < 400 * 400; ++i) {
      const int x = i % 400, y = i / 400;
      pixels[static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(
          square == 0 ? grey(random) : 255 * ((x / square + y / square) % 2));
    }
    const auto targets =
        Recognize(ImageView8(pixels.data(), 400, 400), RecognitionOptions{}, Schneider());
    EXPECT_LE(targets.size(), 3u) << "squares of " << square;
    for (const Target& target : targets) EXPECT_FALSE(target.ring.id.has_value());
  }
}

TEST(RecognizerTest, EqualsOneByOneForAnyNumberOfThreads) {
  // Sizes and depths differ, and frames with nothing stand between.
  std::vector<Picture<std::uint16_t>> deep;
  std::vector<std::vector<std::uint8_t>> shallow;
  for (unsigned seed = 1; seed <= 3; ++seed) {
    const int width = 200 + 10 * static_cast<int>(seed);
    deep.push_back(Render(width, 200, ThreeTargets(), 3000, 300, 10, seed));
    auto& pixels = shallow.emplace_back();
    for (const auto pixel : deep.back().pixels) {
      pixels.push_back(static_cast<std::uint8_t>(pixel / 16));
    }
  }
  std::vector<FrameView> frames;
  for (std::size_t i = 0; i < deep.size(); ++i) {
    frames.emplace_back(deep[i].view());
    frames.emplace_back(ImageView8());
    frames.emplace_back(ImageView8(shallow[i].data(), deep[i].width, deep[i].height));
  }
  const Recognizer recognizer({}, Schneider());
  for (const int threads : {0, 1, 2, 5}) {
    const auto batch = recognizer.RecognizeFrames(frames, threads);
    ASSERT_EQ(batch.size(), frames.size());
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const auto single = Recognize(frames[i], RecognitionOptions{}, Schneider());
      EXPECT_EQ(single.empty(), i % 3 == 1);
      ASSERT_EQ(batch[i].size(), single.size()) << "frame " << i << ", " << threads << " threads";
      for (std::size_t k = 0; k < single.size(); ++k) {
        EXPECT_EQ(batch[i][k].edge.ellipse.x_px, single[k].edge.ellipse.x_px);
        EXPECT_EQ(batch[i][k].edge.cov, single[k].edge.cov);
        EXPECT_EQ(batch[i][k].ring.id, single[k].ring.id);
      }
    }
  }
}

TEST(RecognizerTest, ChecksBeforeThereAreFrames) {
  const Recognizer recognizer({}, Schneider());
  EXPECT_TRUE(recognizer.RecognizeFrames({}, 2).empty());
  EXPECT_THROW(recognizer.RecognizeFrames({}, -1), std::invalid_argument);
  RecognitionOptions options;
  options.diameter_px = {20, 10};
  EXPECT_THROW(Recognizer(options, Schneider()), std::invalid_argument);
  CodeFamily twice = Schneider();
  twice.codes.push_back(twice.codes.front());
  EXPECT_THROW(Recognizer({}, twice), std::invalid_argument);
}

TEST(RecognizeTest, RefusesWrongOptions) {
  const std::vector<std::uint8_t> pixels(100, 0);
  RecognitionOptions options;
  options.diameter_px = {20, 10};
  EXPECT_THROW(Recognize(ImageView8(pixels.data(), 10, 10), options, Schneider()),
               std::invalid_argument);
  options = {};
  options.method = "guess";
  EXPECT_THROW(Recognize(ImageView8(pixels.data(), 10, 10), options, Schneider()),
               std::invalid_argument);
}

}  // namespace
}  // namespace videogrammetry
