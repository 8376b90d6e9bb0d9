#include "videogrammetry/recognition/edge_pair_search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "synthetic_picture.h"
#include "videogrammetry/recognition/edge_pair_samples.h"
#include "videogrammetry/recognition/gradient_threshold.h"
#include "videogrammetry/recognition/recognize.h"

namespace videogrammetry {
namespace {

using testing::Drawn;
using testing::Render;

constexpr std::array<double, 2> kDiameters = {5.0, 200.0};
constexpr InstructionSet kSets[] = {InstructionSet::kBaseline, InstructionSet::kAvx2,
                                    InstructionSet::kAvx512};

/// The same values in every storage, each in memory of just its size, so that a
/// sanitizer sees a read beyond it.
class Storages {
 public:
  Storages(std::vector<std::uint16_t> values, int width, int height)
      : words_(std::move(values)), bytes_(words_.begin(), words_.end()) {
    views_.push_back(ImageView16(words_.data(), width, height));
    names_.push_back("16");
    const bool fits_bytes = *std::max_element(words_.begin(), words_.end()) < 256;
    if (fits_bytes) Add(ImageView8(bytes_.data(), width, height), "8");
    const auto stride = static_cast<std::size_t>(width) + 13;
    strided_.assign(stride * static_cast<std::size_t>(height - 1) + static_cast<std::size_t>(width),
                    999);
    for (int y = 0; y < height; ++y) {
      std::copy_n(words_.begin() + std::ptrdiff_t{y} * width, width,
                  strided_.begin() + y * static_cast<std::ptrdiff_t>(stride));
    }
    Add(ImageView16(strided_.data(), width, height, static_cast<std::ptrdiff_t>(stride)),
        "16 strided");
    if (width % 2 != 0) return;
    for (const bool high : {true, false}) {
      std::vector<std::uint8_t>& packed = high ? high_first_ : low_first_;
      for (std::size_t i = 0; i + 1 < words_.size(); i += 2) {
        const int a = words_[i], b = words_[i + 1];
        const int low = high ? a >> 4 : a & 255;
        const int middle = high ? (a & 15) << 4 | b >> 8 : a >> 8 | (b & 15) << 4;
        const int last = high ? b & 255 : b >> 4;
        for (const int byte : {low, middle, last}) {
          packed.push_back(static_cast<std::uint8_t>(byte));
        }
      }
      packed.shrink_to_fit();
      Add(Packed12View(packed.data(), width, height,
                       high ? PackedOrder::kHighFirst : PackedOrder::kLowFirst),
          high ? "12 high first" : "12 low first");
    }
  }

  const std::vector<FrameView>& views() const { return views_; }
  const std::string& name(std::size_t i) const { return names_[i]; }

 private:
  void Add(const FrameView& view, const std::string& name) {
    views_.push_back(view);
    names_.push_back(name);
  }

  std::vector<std::uint16_t> words_, strided_;
  std::vector<std::uint8_t> bytes_, high_first_, low_first_;
  std::vector<FrameView> views_;
  std::vector<std::string> names_;
};

std::vector<double> Numbers(const std::vector<DotRegion>& regions) {
  std::vector<double> out;
  for (const DotRegion& r : regions) {
    const ContourMoments& m = r.moments;
    out.insert(out.end(), {m.mean_x, m.mean_y, m.area, m.var_xx, m.var_xy, m.var_yy,
                           static_cast<double>(m.width_px), static_cast<double>(m.height_px),
                           static_cast<double>(r.inside), static_cast<double>(r.outside)});
  }
  return out;
}

void ExpectSameEverywhere(const std::vector<std::uint16_t>& values, int width, int height,
                          const std::string& what) {
  const Storages storages(values, width, height);
  for (const int sign : {1, -1}) {
    const auto expected =
        Numbers(FindDotRegions(storages.views()[0], sign, kDiameters, InstructionSet::kBaseline));
    // Grows from the middle of the dots' edges on, to its most at some of them.
    EdgeThreshold growing = 6;
    growing.from_grey = 90;
    growing.per_grey = 9000;
    growing.most = 17;
    const auto grown = Numbers(
        FindDotRegions(storages.views()[0], sign, kDiameters, growing, InstructionSet::kBaseline));
    for (std::size_t i = 0; i < storages.views().size(); ++i) {
      for (const InstructionSet set : kSets) {
        if (set > DetectInstructionSet()) continue;
        EXPECT_EQ(Numbers(FindDotRegions(storages.views()[i], sign, kDiameters, growing, set)),
                  grown)
            << what << ", growing, width " << width << ", " << storages.name(i) << " bit, sign "
            << sign << ", " << InstructionSetName(set);
        EXPECT_EQ(Numbers(FindDotRegions(storages.views()[i], sign, kDiameters, set)), expected)
            << what << ", width " << width << ", " << storages.name(i) << " bit, sign " << sign
            << ", " << InstructionSetName(set);
      }
    }
  }
}

/// Dots of 6 to 150 px across on a grid of 40 px and more, and some at the border.
std::vector<Drawn> Dots(int width, int height) {
  std::vector<Drawn> dots;
  for (int y = 20, i = 0; y < height; y += 40) {
    for (int x = 21; x < width; x += 40, ++i) {
      dots.push_back({{x + 0.3 * (i % 3), y + 0.2, 4.0 + i % 10, 3.0 + i % 6, 0.3 * i}, {}});
      dots.back().ellipse.semi_major_px =
          std::max(dots.back().ellipse.semi_major_px, dots.back().ellipse.semi_minor_px);
    }
  }
  return dots;
}

TEST(EdgePairSearchTest, EveryStorageAndSetGivesTheSameRegions) {
  for (const int width : {40, 63, 64, 65, 66, 67, 129, 130, 131, 257, 258, 320}) {
    const auto picture = Render(width, 120, Dots(width, 120), 220.0, 20.0, 3.0, 7u);
    ExpectSameEverywhere(picture.pixels, width, 120, "dots");
  }
  const auto deep = Render(300, 200, {{{150.2, 100.4, 75.0, 60.0, 0.4}, {}}}, 3900.0, 100.0, 40.0);
  ExpectSameEverywhere(deep.pixels, 300, 200, "a large dot");
}

TEST(EdgePairSearchTest, EveryStorageAndSetGivesTheSameRegionsOfNoise) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    for (const int largest : {255, 4095}) {
      for (const int width : {3, 4, 65, 194}) {
        std::mt19937 random(seed);
        std::uniform_int_distribution<int> grey(0, largest);
        std::vector<std::uint16_t> values(static_cast<std::size_t>(width) * 97);
        for (auto& v : values) v = static_cast<std::uint16_t>(grey(random));
        ExpectSameEverywhere(values, width, 97, "noise of seed " + std::to_string(seed));
      }
    }
  }
}

TEST(EdgePairSearchTest, TheKernelsOfAGrowingThresholdAreItsDefinition) {
  const EdgeThreshold growing = ThresholdByNoise(12, {2.0, 0.11, 0.1}, 1);
  const edge_pair::Growth growth = {growing.from_grey, growing.per_grey, growing.most};
  for (const int width : {3, 30, 65, 66, 67, 130, 194, 200}) {
    std::mt19937 random(static_cast<unsigned>(width));
    std::uniform_int_distribution<int> grey(0, 255);
    std::vector<std::uint16_t> values(static_cast<std::size_t>(width));
    for (auto& v : values) v = static_cast<std::uint16_t>(grey(random) * grey(random) / 255);
    const Storages storages(values, width, 1);
    for (std::size_t s = 0; s < storages.views().size(); ++s) {
      for (const InstructionSet set : kSets) {
        if (set > DetectInstructionSet()) continue;
        const edge_pair::SampleRows rows(storages.views()[s], 1, set);
        const auto words = static_cast<std::size_t>(width + 61) / 64;
        std::vector<std::uint64_t> up(words), down(words);
        std::vector<int> which(words + 1);
        const int any = rows.kernels->edges(rows.row(0), width, growing.least, up.data(),
                                            down.data(), which.data());
        rows.kernels->brighter(rows.row(0), width, growing.least, growth, up.data(), down.data(),
                               which.data(), any);
        for (std::size_t i = 0; i + 2 < values.size(); ++i) {
          const int a = values[i], b = values[i + 2];
          EXPECT_EQ(up[i / 64] >> (i % 64) & 1, b - a > growing.At(b) ? 1u : 0u);
          EXPECT_EQ(down[i / 64] >> (i % 64) & 1, a - b > growing.At(a) ? 1u : 0u)
              << storages.name(s) << " bit, width " << width << ", " << InstructionSetName(set);
        }
      }
    }
  }
}

TEST(EdgePairSearchTest, TheThresholdFollowsTheNoise) {
  const GreyNoise noise = {0.3, 0.0226, 0.1};
  const EdgeThreshold threshold = ThresholdByNoise(6, noise, 1);
  EXPECT_EQ(threshold.At(0), 6);
  for (int grey = 0; grey < 256; ++grey) {
    const double four = 4.0 * std::sqrt(2.0 * noise.Variance(grey));
    // The line lies 5 % below the root in the middle, and steps are whole.
    EXPECT_GT(threshold.At(grey), std::min(0.94 * four, 18.0) - 1.0) << grey;
    EXPECT_LT(threshold.At(grey), std::max(6.0, 1.1 * four) + 1.0) << grey;
  }
  EXPECT_EQ(threshold.At(65535), 18);
  // Of dark dots the values are negative, and the noise's slope is.
  EXPECT_EQ(ThresholdByNoise(6, {0.3, -0.0226, 0.1}, -1).At(173), threshold.At(173));
  EXPECT_FALSE(ThresholdByNoise(6, {0.3, -0.0226, 0.1}, 1).Grows());
}

/// The region whose centre is within a pixel of (x, y).
const DotRegion* At(const std::vector<DotRegion>& regions, double x, double y) {
  for (const DotRegion& r : regions) {
    if (std::hypot(r.moments.mean_x - x, r.moments.mean_y - y) < 1.0) return &r;
  }
  return nullptr;
}

TEST(EdgePairSearchTest, FindsEveryDotWithItsMoments) {
  const std::vector<Drawn> dots = Dots(400, 320);
  const auto picture = Render(400, 320, dots, 3000.0, 300.0, 30.0);
  const auto regions = FindDotRegions(picture.view(), 1, kDiameters);
  EXPECT_GE(regions.size(), dots.size());  // some from more than one row
  for (const Drawn& dot : dots) {
    const Ellipse& e = dot.ellipse;
    const DotRegion* region = At(regions, e.x_px, e.y_px);
    ASSERT_NE(region, nullptr) << e.x_px << ", " << e.y_px;
    // A pixel belongs to the area or not: its border is uncertain by 1 / sqrt(12) px in
    // each of about 4 r pixels, the centre and the axes by less than 0.29 / sqrt(4 r);
    // five of these. The blur of variance v moves the level inwards by v / 2 times the
    // border's curvature, at most a / b^2.
    const double bound = 5 * 0.29 / std::sqrt(4 * e.semi_minor_px) +
                         0.25 * e.semi_major_px / (e.semi_minor_px * e.semi_minor_px);
    const auto found = EllipseFromMoments(region->moments);
    EXPECT_NEAR(found->x_px, e.x_px, bound);
    EXPECT_NEAR(found->y_px, e.y_px, bound);
    EXPECT_NEAR(found->semi_major_px, e.semi_major_px, bound);
    EXPECT_NEAR(found->semi_minor_px, e.semi_minor_px, bound);
  }
}

TEST(EdgePairSearchTest, FindsDotsOfAnySizeTiltAndTurn) {
  for (const double radius : {3.0, 8.0, 25.0, 95.0}) {
    for (const double ratio : {1.0, 0.6, 0.3}) {
      if (radius * ratio < 2.5) continue;
      for (double turn = 0.0; turn < 3.1; turn += 0.37) {
        const Ellipse ellipse{140.3, 120.6, radius, ratio * radius, turn};
        const auto picture = Render(281, 240, {{ellipse, {}}}, 3000.0, 300.0);
        const auto regions = FindDotRegions(picture.view(), 1, kDiameters);
        ASSERT_FALSE(regions.empty()) << radius << ", " << ratio << ", " << turn;
        for (const DotRegion& region : regions) {
          // Ends between pixels, by a straight line through a blurred edge: some tenths.
          EXPECT_NEAR(region.moments.mean_x, ellipse.x_px, 0.3);
          EXPECT_NEAR(region.moments.mean_y, ellipse.y_px, 0.3);
          const double area = region.moments.area / (3.14159265 * radius * ratio * radius);
          EXPECT_NEAR(std::sqrt(area), 1.0, 0.05 + 0.5 / (ratio * radius));
        }
      }
    }
  }
}

TEST(EdgePairSearchTest, PartsGiveWhatTheWholeGives) {
  const auto picture = Render(400, 320, Dots(400, 320), 3000.0, 300.0, 30.0);
  const FrameView frame = picture.view();
  const int threshold = GradientThreshold(SampleGreyStatistics(frame));
  const auto whole = FindDotRegions(frame, 1, kDiameters, threshold);
  ASSERT_GT(whole.size(), 50u);
  for (const DotRegion& region : whole) {
    const ContourMoments& m = region.moments;
    const int x = static_cast<int>(m.mean_x), y = static_cast<int>(m.mean_y);
    const std::vector<SearchWindow> window = {{x - 20, y - 19, x + 19, y + 20}};
    const auto part = FindDotRegions(frame, 1, kDiameters, threshold, window);
    const auto expected = Numbers({region});
    EXPECT_TRUE(std::any_of(part.begin(), part.end(),
                            [&](const DotRegion& other) { return Numbers({other}) == expected; }))
        << x << ", " << y;
  }
  EXPECT_TRUE(FindDotRegions(frame, 1, kDiameters, threshold, std::vector<SearchWindow>{}).empty());
  const std::vector<SearchWindow> beyond = {
      {-50, -50, -1, -1}, {399, 0, 500, 20}, {0, 330, 9, 340}};
  EXPECT_TRUE(FindDotRegions(frame, 1, kDiameters, threshold, beyond).empty());
}

TEST(EdgePairSearchTest, FindsADotWithADarkRimOnBrighterGround) {
  auto picture = Render(120, 120, {{{60.0, 60.0, 16.0, 16.0, 0.0}, {}}}, 300.0, 3000.0);
  const auto dot = Render(120, 120, {{{60.0, 60.0, 8.0, 8.0, 0.0}, {}}}, 2000.0, 0.0);
  for (std::size_t i = 0; i < picture.pixels.size(); ++i) picture.pixels[i] += dot.pixels[i];
  const auto regions = FindDotRegions(picture.view(), 1, kDiameters);
  const DotRegion* region = At(regions, 60.0, 60.0);
  ASSERT_NE(region, nullptr);
  EXPECT_NEAR(region->inside, 2300.0, 20.0);
  EXPECT_NEAR(region->outside, 300.0, 60.0);
}

TEST(EdgePairSearchTest, NothingThatTheBorderCutsAndNoOtherShapeIsATarget) {
  std::vector<Drawn> cut = {{{1.0, 40.0, 8.0, 8.0, 0.0}, {}}, {{40.0, 158.0, 8.0, 8.0, 0.0}, {}}};
  auto picture = Render(160, 160, cut, 3000.0, 300.0);
  for (int y = 60; y < 90; ++y) {
    for (int x = 60; x < 100; ++x) {
      // A letter L and, beside it, a triangle.
      if (y > 80 || x < 68) picture.pixels[static_cast<std::size_t>(160 * y + x)] = 3000;
    }
    for (int x = 120; x < 120 + y - 60; ++x) {
      picture.pixels[static_cast<std::size_t>(160 * y + x)] = 3000;
    }
  }
  RecognitionOptions options;
  options.method = kEdgePair;
  options.estimator = Estimator::kModel;
  EXPECT_TRUE(Recognize(picture.view(), options, NamedCodeFamily("none")).empty());
  // What is left to the fit is little: the triangle.
  EXPECT_LE(FindDotRegions(picture.view(), 1, kDiameters).size(), 3u);
}

TEST(EdgePairSearchTest, StatisticsAreTheSameOfEveryStorageAndNearThoseOfMorePixels) {
  const auto picture = Render(640, 480, Dots(640, 480), 3000.0, 300.0, 30.0);
  const Storages storages(picture.pixels, 640, 480);
  const GreyStatistics expected = MeasureGreyStatistics(picture.view());
  const GreyStatistics first = SampleGreyStatistics(storages.views()[0], InstructionSet::kBaseline);
  // Of n values the median's deviation is 1.25 sigma / sqrt(n), less for the folded
  // normal's: with 8192 values, neighbours alike, well within a tenth.
  EXPECT_NEAR(first.median_gradient, expected.median_gradient, 0.1 * expected.median_gradient);
  EXPECT_NEAR(first.low, expected.low, 30.0);
  EXPECT_NEAR(first.high, expected.high, 30.0);
  for (const FrameView& view : storages.views()) {
    for (const InstructionSet set : kSets) {
      if (set > DetectInstructionSet()) continue;
      const GreyStatistics s = SampleGreyStatistics(view, set);
      EXPECT_EQ(s.low, first.low);
      EXPECT_EQ(s.high, first.high);
      EXPECT_EQ(s.median_gradient, first.median_gradient);
    }
  }
}

TEST(EdgePairSearchTest, PassesOverKnownPartsAndNothingElse) {
  const std::vector<testing::Drawn> dots = {
      {{40.0, 50.0, 8.0, 6.0, 0.5}, testing::Bits(0x0b35, 14)},
      {{90.0, 50.0, 7.0, 7.0, 0.0}, {}},
      {{68.0, 50.0, 3.5, 3.5, 0.0}, {}}};
  const auto picture = testing::Render(120, 100, dots, 3000.0, 300.0, 20.0);
  const std::vector<SearchWindow> whole = {{0, 0, 119, 99}};
  const auto in_part = [](const DotRegion& r, const Ellipse& e, double radii) {
    return std::hypot(r.moments.mean_x - e.x_px, r.moments.mean_y - e.y_px) <
           radii * e.semi_major_px;
  };
  KnownParts known(120, 100);
  known.Add(dots[0].ellipse, 3.1);
  const auto all = FindDotRegions(picture.view(), 1, {5.0, 60.0}, 400, whole);
  const auto left = FindDotRegions(picture.view(), 1, {5.0, 60.0}, 400, whole, &known);
  std::size_t outside = 0;
  for (const DotRegion& r : all) outside += in_part(r, dots[0].ellipse, 3.3) ? 0 : 1;
  EXPECT_LT(left.size(), all.size());
  EXPECT_EQ(left.size(), outside);
  for (const std::size_t k : {1u, 2u}) {
    EXPECT_TRUE(std::any_of(left.begin(), left.end(), [&](const DotRegion& r) {
      return in_part(r, dots[k].ellipse, 0.2);
    })) << k;
  }
}

}  // namespace
}  // namespace videogrammetry
