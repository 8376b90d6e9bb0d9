#include "videogrammetry/recognition/dual_conic.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "synthetic_picture.h"

namespace videogrammetry {
namespace {

using testing::Picture;

constexpr double kBright = 3000.0, kDark = 300.0;
/// Spread of the binomial blur and the pixel, and of the difference quotient as in TargetEdge.
const double kWidthPx = std::sqrt(0.5 + 2.0 / 12.0);

struct Dot {
  Ellipse ellipse{23.4, 22.7, 6.0, 5.0, 0.6};
  double noise = 0.0;
};

TargetEdge StartOf(const Dot& dot) {
  TargetEdge start;
  start.ellipse = dot.ellipse;
  start.ellipse.x_px += 0.03;
  start.ellipse.y_px -= 0.04;
  start.ellipse.semi_major_px += 0.03;
  start.inside = kBright;
  start.outside = kDark;
  start.width_px = kWidthPx;
  return start;
}

Picture<std::uint16_t> PictureOf(const Dot& dot, unsigned seed) {
  return testing::Render(48, 46, {{dot.ellipse, {}}}, kBright, kDark, dot.noise, seed);
}

std::optional<DualConicFit> Fit(const FrameView& frame, const TargetEdge& start, int sign = 1) {
  WindowReader reader(frame, sign);
  return FitDualConic(reader.Read(0, 0, FrameWidth(frame) - 1, FrameHeight(frame) - 1), start);
}

TEST(DualConicTest, FindsTheEllipseWithoutNoise) {
  double squares = 0;
  int count = 0;
  for (const double radius : {4.0, 6.0, 10.0}) {
    for (const double aspect : {0.71, 0.85, 1.0}) {
      for (int k = 0; k < 6; ++k) {
        Dot dot;
        dot.ellipse = {23 + 0.17 * k, 22 + 0.29 * k - std::floor(0.29 * k), radius, radius * aspect,
                       0.5 * k};
        const auto fit = Fit(PictureOf(dot, 1).view(), StartOf(dot));
        ASSERT_TRUE(fit) << radius << " " << aspect << " " << k;
        const double x = fit->ellipse.x_px - dot.ellipse.x_px;
        const double y = fit->ellipse.y_px - dot.ellipse.y_px;
        squares += 0.5 * (x * x + y * y);
        ++count;
        // The renderer's 8 x 8 points a pixel leave 1/32 px at a place of the contour.
        EXPECT_LT(std::hypot(x, y), 0.04) << radius << " " << aspect << " " << k;
        // Next to the order of blur^4 / radius^3 there is the band's end, asymmetric in
        // the curvature: a few hundredths for the smallest.
        EXPECT_NEAR(fit->ellipse.semi_major_px, dot.ellipse.semi_major_px, 0.06);
        EXPECT_NEAR(fit->ellipse.semi_minor_px, dot.ellipse.semi_minor_px, 0.06);
        // Weights are squares of a blurred step's slope: half the variance of the blur,
        // the pixel and the central difference.
        EXPECT_NEAR(fit->spread_px, std::sqrt(0.5 * (0.5 + 1.0 / 12.0 + 1.0 / 3.0)), 0.1);
      }
    }
  }
  EXPECT_LT(std::sqrt(squares / count), 0.012);
}

/// The scatter of many pictures' results is what each one's covariance says.
///
/// A standard deviation from n results is known to 1 / sqrt(2 n): 400 give 3.5 %, so that
/// 20 % are more than five of it. The constant that stands for the pixels' places
/// is not seen in pictures of one place and taken off.
TEST(DualConicTest, CovarianceIsThatOfTheScatter) {
  constexpr int kPictures = 400;
  constexpr double kSampling = 0.0018;
  for (const double noise : {36.0, 84.0}) {  // contrast over noise 75 and 32
    for (const double radius : {4.0, 6.0, 10.0}) {
      Dot dot;
      dot.noise = noise;
      dot.ellipse = {23.37, 22.81, radius, 0.8 * radius, 0.7};
      Eigen::Matrix<double, 5, 1> sum = Eigen::Matrix<double, 5, 1>::Zero(), squares = sum;
      Eigen::Matrix<double, 5, 1> predicted = sum;
      for (int k = 0; k < kPictures; ++k) {
        const auto fit = Fit(PictureOf(dot, static_cast<unsigned>(k + 1)).view(), StartOf(dot));
        ASSERT_TRUE(fit) << k;
        const Ellipse& e = fit->ellipse;
        const Eigen::Matrix<double, 5, 1> values = {e.x_px, e.y_px, e.semi_major_px,
                                                    e.semi_minor_px, e.angle_rad};
        sum += values;
        squares += values.cwiseAbs2();
        predicted += fit->cov.diagonal();
      }
      const Eigen::Matrix<double, 5, 1> mean = sum / kPictures;
      const Eigen::Matrix<double, 5, 1> variance = squares / kPictures - mean.cwiseAbs2();
      predicted /= kPictures;
      predicted.head<2>().array() -= kSampling * kSampling;
      predicted.segment<2>(2).array() -= 4 * kSampling * kSampling;
      for (int i = 0; i < 5; ++i) {
        EXPECT_NEAR(std::sqrt(predicted[i] / variance[i]), 1.0, 0.2)
            << "noise " << noise << " radius " << radius << " parameter " << i;
      }
    }
  }
}

TEST(DualConicTest, IsTheSameInEveryDepthAndPolarity) {
  const Dot dot;
  const auto picture = PictureOf(dot, 1);
  const auto expected = Fit(picture.view(), StartOf(dot));
  ASSERT_TRUE(expected);
  // Packed, high bits first: 48 samples a row in 72 bytes.
  std::vector<std::uint8_t> packed;
  for (std::size_t i = 0; i < picture.pixels.size(); i += 2) {
    const int a = picture.pixels[i], b = picture.pixels[i + 1];
    packed.push_back(static_cast<std::uint8_t>(a >> 4));
    packed.push_back(static_cast<std::uint8_t>((a & 15) << 4 | b >> 8));
    packed.push_back(static_cast<std::uint8_t>(b));
  }
  const Packed12View view(packed.data(), 48, 46, PackedOrder::kHighFirst);
  const auto of_packed = Fit(view, StartOf(dot));
  ASSERT_TRUE(of_packed);
  EXPECT_EQ(of_packed->ellipse.x_px, expected->ellipse.x_px);
  EXPECT_EQ(of_packed->cov(0, 0), expected->cov(0, 0));
  // Black on white: the same contour, grey values below zero.
  std::vector<std::uint16_t> negative;
  for (const auto grey : picture.pixels)
    negative.push_back(static_cast<std::uint16_t>(4095 - grey));
  TargetEdge start = StartOf(dot);
  start.inside -= 4095;
  start.outside -= 4095;
  const auto of_negative = Fit(ImageView16(negative.data(), 48, 46), start, -1);
  ASSERT_TRUE(of_negative);
  EXPECT_NEAR(of_negative->ellipse.x_px, expected->ellipse.x_px, 1e-9);
  EXPECT_NEAR(of_negative->cov(0, 0), expected->cov(0, 0), 1e-12);
}

TEST(DualConicTest, RefusesWhatIsNoDot) {
  const Dot dot;
  const std::vector<std::uint16_t> even(48 * 46, 500);
  EXPECT_FALSE(Fit(ImageView16(even.data(), 48, 46), StartOf(dot)));
  std::vector<std::uint16_t> ramp;
  for (int i = 0; i < 48 * 46; ++i) ramp.push_back(static_cast<std::uint16_t>(10 * (i % 48)));
  EXPECT_FALSE(Fit(ImageView16(ramp.data(), 48, 46), StartOf(dot)));
  // A dot elsewhere is not this one.
  Dot other;
  other.ellipse.x_px += 1.5;
  EXPECT_FALSE(Fit(PictureOf(other, 1).view(), StartOf(dot)));
  // Nor is there anything outside the picture.
  TargetEdge outside = StartOf(dot);
  outside.ellipse.x_px = 500;
  EXPECT_FALSE(Fit(PictureOf(dot, 1).view(), outside));
  WindowReader reader(FrameView(ImageView16()), 1);
  EXPECT_FALSE(FitDualConic(reader.Read(0, 0, 10, 10), StartOf(dot)));
}

TEST(DualConicTest, LeavesWhatItCannotFit) {
  const Dot dot;
  const auto picture = PictureOf(dot, 1);
  TargetEdge good = StartOf(dot), bad = StartOf(dot);
  bad.ellipse.x_px = 500;
  RefineByDualConic(picture.view(), 1, {&bad, &good});
  EXPECT_EQ(bad.ellipse.x_px, 500);
  EXPECT_NEAR(good.ellipse.x_px, dot.ellipse.x_px, 0.02);
  EXPECT_GT(good.cov(0, 0), 0);
}

}  // namespace
}  // namespace videogrammetry
