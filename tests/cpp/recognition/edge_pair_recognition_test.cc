#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "synthetic_picture.h"
#include "videogrammetry/recognition/dot_look.h"
#include "videogrammetry/recognition/recognize.h"

namespace videogrammetry {
namespace {

using testing::Drawn;
using testing::Picture;
using testing::Render;

constexpr int kSize = 320;
constexpr double kBright = 3000.0, kDark = 300.0;

std::vector<Drawn> Grid(double radius, double pitch) {
  std::vector<Drawn> shapes;
  for (double y = pitch; y < kSize - 0.5 * pitch; y += pitch) {
    for (double x = pitch; x < kSize - 0.5 * pitch; x += pitch) {
      const double aside = std::fmod(0.37 * x + 0.71 * y, 1.0);
      shapes.push_back({{x + aside, y - aside, 1.1 * radius, radius, 0.4}, {}, 0.0});
    }
  }
  return shapes;
}

/// How far a picture's pixels are covered by its shapes, 0 to 1.
std::vector<double> Coverage(const std::vector<Drawn>& shapes) {
  const auto picture = Render(kSize, kSize, shapes, 60000.0, 0.0);
  std::vector<double> coverage;
  for (const auto pixel : picture.pixels) coverage.push_back(pixel / 60000.0);
  return coverage;
}

Picture<std::uint16_t> Paint(const std::function<double(std::size_t, int, int)>& grey) {
  Picture<std::uint16_t> picture{kSize, kSize, {}};
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      picture.pixels.push_back(static_cast<std::uint16_t>(
          std::lround(grey(static_cast<std::size_t>(y * kSize + x), x, y))));
    }
  }
  return picture;
}

/// Deterministic, about normal, of deviation 1.
double Noise(int x, int y, int seed) {
  double sum = 0.0;
  for (int k = 0; k < 12; ++k) {
    const double v = std::sin(12.9898 * x + 78.233 * y + 37.719 * (seed + 12 * k)) * 43758.5453;
    sum += v - std::floor(v);
  }
  return sum - 6.0;
}

std::vector<Target> RecognizeIn(const Picture<std::uint16_t>& picture, Polarity polarity) {
  RecognitionOptions options;
  options.method = kEdgePair;
  options.estimator = Estimator::kModel;
  options.polarity = polarity;
  options.codes = "none";
  return Recognize(picture.view(), options, CodeFamily{});
}

/// Largest distance of a shape's centre from the nearest target.
double LargestError(const std::vector<Drawn>& shapes, const std::vector<Target>& targets) {
  double largest = 0.0;
  for (const Drawn& shape : shapes) {
    double nearest = 1e9;
    for (const Target& target : targets) {
      nearest = std::min(nearest, std::hypot(target.edge.ellipse.x_px - shape.ellipse.x_px,
                                             target.edge.ellipse.y_px - shape.ellipse.y_px));
    }
    largest = std::max(largest, nearest);
  }
  return largest;
}

TEST(EdgePairRecognitionTest, FindsDotsOnANarrowRim) {
  const auto dots = Grid(8.0, 60.0);
  auto rims = dots;
  for (Drawn& rim : rims) {
    rim.ellipse.semi_major_px += 3.0;
    rim.ellipse.semi_minor_px += 3.0;
  }
  const auto dot = Coverage(dots), rim = Coverage(rims);
  const auto picture = Paint([&](std::size_t i, int x, int y) {
    const double ground = (1.0 - rim[i]) * (2500.0 + 300.0 * Noise(x / 2, y / 2, 1));
    return 300.0 + ground + 1700.0 * dot[i] + 10.0 * Noise(x, y, 2);
  });
  const auto targets = RecognizeIn(picture, Polarity::kWhiteOnBlack);
  // Twenty-fold what the noise does to a contour of 50 px: the rim is 4 blurs wide.
  EXPECT_LT(LargestError(dots, targets), 0.04);
}

TEST(EdgePairRecognitionTest, FindsDotsWithTexture) {
  const auto dots = Grid(14.0, 60.0);
  const auto dot = Coverage(dots);
  // Five times the ground's noise, which the threshold follows, in the dots alone.
  const auto picture = Paint([&](std::size_t i, int x, int y) {
    return 3000.0 - 2600.0 * dot[i] + (10.0 + 40.0 * dot[i]) * Noise(x, y, 3);
  });
  const auto targets = RecognizeIn(picture, Polarity::kBlackOnWhite);
  EXPECT_EQ(targets.size(), dots.size());
  // An edge of blur s and length L: s_n / C sqrt(2 sqrt(pi) s / (L / 2)) = 0.005 px; five-fold.
  EXPECT_LT(LargestError(dots, targets), 0.025);
}

// Noise whose variance is proportional to the grey value is light's own; what only the dots
// have is texture, whose second search a camera's model keeps.
TEST(EdgePairRecognitionTest, NoiseThatGrowsWithTheLightIsNoTexture) {
  const auto dots = Grid(14.0, 60.0);
  const auto dot = Coverage(dots);
  RecognitionOptions options;
  options.method = kEdgePair;
  options.codes = "none";
  for (const bool textured : {false, true}) {
    const auto picture = Paint([&](std::size_t i, int x, int y) {
      const double grey = 300.0 + 2700.0 * dot[i];
      const double variance = textured ? 100.0 + 9900.0 * dot[i] : grey;
      return grey + std::sqrt(variance) * Noise(x, y, 5);
    });
    const Recognizer recognizer(options, CodeFamily{});
    const auto camera = recognizer.Learn(picture.view());
    ASSERT_TRUE(camera.has_value());
    EXPECT_EQ(camera->second_threshold != 0, textured);
    const FrameView frame = picture.view();
    EXPECT_EQ(recognizer.RecognizeFrames({frame}, 1, &*camera)[0].size(), dots.size());
    EXPECT_EQ(recognizer.RecognizeFrames({frame}, 1)[0].size(), dots.size());
  }
}

TEST(EdgePairRecognitionTest, LightThatIsAddedMovesNoDot) {
  const auto dots = Grid(12.0, 60.0);
  const auto dot = Coverage(dots);
  constexpr double kFlare = 0.03;  // of the contrast over a radius
  const auto picture = Paint([&](std::size_t i, int x, int y) {
    double flare = 0.0;
    for (const Drawn& shape : dots) {
      const double dx = x - shape.ellipse.x_px, dy = y - shape.ellipse.y_px;
      if (std::hypot(dx, dy) < 20.0) flare = kFlare * 2600.0 * dx / 12.0 * dot[i];
    }
    return 3000.0 - 2600.0 * dot[i] + flare + 20.0 * Noise(x, y, 4);
  });
  const auto targets = RecognizeIn(picture, Polarity::kBlackOnWhite);
  EXPECT_EQ(targets.size(), dots.size());
  // Without a model of it: 2.5 blurs times the flare, 0.055 px. The noise: 0.002 px.
  EXPECT_LT(LargestError(dots, targets), 0.02);
}

TEST(DotLookTest, FlareIsSeenAndCleanDotsHaveNone) {
  const std::vector<Drawn> dots = {{{100.3, 90.6, 12.0, 11.0, 0.3}, {}, 0.0}};
  const auto dot = Coverage(dots);
  for (const double flare : {0.0, 0.02}) {
    const auto picture = Paint([&](std::size_t i, int x, int y) {
      return 3000.0 + dot[i] * (-2600.0 + flare * 2600.0 * (x - 100.3) / 12.0) +
             20.0 * Noise(x, y, 5);
    });
    WindowReader reader(picture.view(), -1);
    ModelFit fit;
    fit.ellipse = dots[0].ellipse;
    fit.inside = -400.0;
    fit.outside = -3000.0;
    fit.blur_px = 0.76;
    const auto sample = MeasureFlare(reader.Read(80, 70, 120, 110), fit);
    ASSERT_TRUE(sample);
    // Each coordinate has its noise; four deviations.
    EXPECT_NEAR(std::sqrt(sample->square), flare, 4.0 * std::sqrt(2.0 * sample->noise));
    EXPECT_LT(std::sqrt(sample->noise), 0.002);
  }
}

}  // namespace
}  // namespace videogrammetry
