#include "videogrammetry/recognition/dot_fit.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <random>
#include <vector>

namespace videogrammetry {
namespace {

constexpr int kSize = 48;
constexpr double kBright = 3000.0, kDark = 300.0, kBlurPx = 0.75;

/// A disc or ellipse blurred by a Gaussian and the pixel's box, as the sum of the lens'
/// blur over 6 x 6 points a pixel: a coverage of another kind than the fit's.
std::vector<double> Blurred(const Ellipse& e) {
  constexpr int kFine = 6, kReach = 4;
  const double lens = std::sqrt(kBlurPx * kBlurPx - 1.0 / 12.0);
  const double c = std::cos(e.angle_rad), s = std::sin(e.angle_rad);
  const int fine_size = kSize * kFine;
  std::vector<double> fine(static_cast<std::size_t>(fine_size * fine_size)), across(fine.size());
  for (int j = 0; j < fine_size; ++j) {
    for (int i = 0; i < fine_size; ++i) {
      const double x = (i + 0.5) / kFine - 0.5 - e.x_px, y = (j + 0.5) / kFine - 0.5 - e.y_px;
      const double u = (c * x + s * y) / e.semi_major_px, v = (-s * x + c * y) / e.semi_minor_px;
      // The border's part of the fine pixel, to first order.
      const double rho = std::hypot(u, v);
      const double slope =
          std::hypot(u / e.semi_major_px, v / e.semi_minor_px) / std::max(rho, 0.1);
      const double inside = (1.0 - rho) / std::max(slope, 1e-3) * kFine + 0.5;
      fine[static_cast<std::size_t>(j * fine_size + i)] = std::min(1.0, std::max(0.0, inside));
    }
  }
  std::vector<double> kernel;
  const int reach = static_cast<int>(kReach * lens * kFine);
  double total = 0;
  for (int k = -reach; k <= reach; ++k) {
    kernel.push_back(std::exp(-0.5 * k * k / (lens * lens * kFine * kFine)));
    total += kernel.back();
  }
  const auto smooth = [&](const std::vector<double>& in, int step, std::vector<double>* out) {
    for (int j = 0; j < fine_size; ++j) {
      for (int i = 0; i < fine_size; ++i) {
        const int at = j * fine_size + i, along = step == 1 ? i : j;
        double sum = 0;
        for (int k = -reach; k <= reach; ++k) {
          if (along + k < 0 || along + k >= fine_size) continue;
          sum += kernel[static_cast<std::size_t>(k + reach)] *
                 in[static_cast<std::size_t>(at + k * step)];
        }
        (*out)[static_cast<std::size_t>(at)] = sum / total;
      }
    }
  };
  smooth(fine, 1, &across);
  smooth(across, fine_size, &fine);
  std::vector<double> grey(kSize * kSize);
  for (int j = 0; j < fine_size; ++j) {
    for (int i = 0; i < fine_size; ++i) {
      grey[static_cast<std::size_t>(j / kFine * kSize + i / kFine)] +=
          fine[static_cast<std::size_t>(j * fine_size + i)] / (kFine * kFine);
    }
  }
  for (double& g : grey) g = kDark + (kBright - kDark) * g;
  return grey;
}

struct Noise {
  double at_zero, per_grey;
};

std::vector<std::uint16_t> Sampled(const std::vector<double>& grey, const Noise& noise,
                                   std::mt19937* random) {
  std::normal_distribution<double> normal;
  std::vector<std::uint16_t> samples;
  for (const double g : grey) {
    const double value = g + std::sqrt(noise.at_zero + noise.per_grey * g) * normal(*random);
    samples.push_back(static_cast<std::uint16_t>(std::lround(std::max(0.0, value))));
  }
  return samples;
}

/// Light that changes over the dot, by as much a radius as the deviation says (in units of
/// the contrast: of the bright value it is 0.9 of that).
std::vector<double> Lit(std::vector<double> grey, const Ellipse& e, double deviation,
                        std::mt19937* random) {
  std::normal_distribution<double> normal(0.0, deviation * (kBright - kDark) / kBright);
  const double gx = normal(*random), gy = normal(*random);
  const Eigen::Matrix2d inverse = EllipseFrame::From(e).shape.inverse();
  for (int j = 0; j < kSize; ++j) {
    for (int i = 0; i < kSize; ++i) {
      const Eigen::Vector2d v = inverse * Eigen::Vector2d(i - e.x_px, j - e.y_px);
      grey[static_cast<std::size_t>(j * kSize + i)] *= 1.0 + gx * v.x() + gy * v.y();
    }
  }
  return grey;
}

PictureModel Model(const Noise& noise) {
  PictureModel picture;
  picture.noise.at_zero = noise.at_zero + 1.0 / 12.0;
  picture.noise.per_grey = noise.per_grey;
  picture.blur_px = kBlurPx;
  picture.blur_sigma_px = 0.02;
  picture.gradient = 0.003;
  return picture;
}

std::optional<ModelFit> FitIn(const std::vector<std::uint16_t>& samples, const Ellipse& start,
                              const PictureModel* picture,
                              InstructionSet set = DetectInstructionSet()) {
  WindowReader reader(ImageView16(samples.data(), kSize, kSize), 1, set);
  const GreyWindow window = reader.Read(0, 0, kSize - 1, kSize - 1);
  return DotFitter(set).Fit(window, {EllipseFrame::From(start), 0.95 * kBright, 1.1 * kDark},
                            picture);
}

Ellipse Aside(Ellipse e) {
  e.x_px += 0.2;
  e.y_px -= 0.15;
  e.semi_major_px *= 1.03;
  return e;
}

TEST(DotFitTest, EveryInstructionSetGivesTheSameBits) {
  std::mt19937 random(3);
  for (const double radius : {2.6, 5.0, 9.5}) {
    const Ellipse e{23.4, 24.1, radius, 0.8 * radius, 0.6};
    const auto samples = Sampled(Blurred(e), {100.0, 0.2}, &random);
    const PictureModel picture = Model({100.0, 0.2});
    const auto expected = FitIn(samples, Aside(e), &picture, InstructionSet::kBaseline);
    ASSERT_TRUE(expected) << radius;
    for (const InstructionSet set : {InstructionSet::kAvx2, InstructionSet::kAvx512}) {
      if (set > DetectInstructionSet()) continue;
      const auto fit = FitIn(samples, Aside(e), &picture, set);
      ASSERT_TRUE(fit);
      EXPECT_EQ(fit->ellipse.x_px, expected->ellipse.x_px);
      EXPECT_EQ(fit->ellipse.y_px, expected->ellipse.y_px);
      EXPECT_EQ(fit->cov, expected->cov);
      EXPECT_EQ(fit->blur_px, expected->blur_px);
    }
  }
}

TEST(DotFitTest, WithoutNoiseTheCentreIsExact) {
  std::mt19937 random(5);
  for (const double radius : {3.0, 4.0, 6.0, 10.0}) {
    for (const double ratio : {1.0, 0.7}) {
      if (radius * ratio < 2.5) continue;  // smaller than what is looked for by default
      for (int k = 0; k < 8; ++k) {
        const Ellipse e{23.0 + 0.137 * k, 24.0 + 0.211 * k, radius, ratio * radius, 0.4 * k};
        const auto samples = Sampled(Blurred(e), {0.0, 0.0}, &random);
        const PictureModel picture = Model({25.0, 0.0});
        const auto fit = FitIn(samples, Aside(e), &picture);
        ASSERT_TRUE(fit) << radius << ", " << ratio;
        // The fine picture's border is good to first order in a pixel of 1 / 6 px, and the
        // last step may leave a twentieth of 0.01 px: 3e-3 px. The axes hold what the model
        // leaves out, too: even about the centre.
        EXPECT_NEAR(fit->ellipse.x_px, e.x_px, 3e-3);
        EXPECT_NEAR(fit->ellipse.y_px, e.y_px, 3e-3);
        EXPECT_NEAR(fit->ellipse.semi_major_px, e.semi_major_px, 0.03);
        EXPECT_NEAR(fit->ellipse.semi_minor_px, e.semi_minor_px, 0.03);
      }
    }
  }
}

TEST(DotFitTest, CovarianceIsTheErrorsOwn) {
  constexpr int kDraws = 500;
  const Ellipse e{23.37, 24.11, 6.0, 4.8, 0.6};
  const auto grey = Blurred(e);
  for (const double contrast_over_noise : {100.0, 30.0, 13.0}) {
    const double sigma = (kBright - kDark) / contrast_over_noise;
    const Noise noise = {0.3 * sigma * sigma, 0.7 * sigma * sigma / kBright};
    const PictureModel picture = Model(noise);
    std::mt19937 random(11);
    double square = 0, sums[5] = {}, bias_x = 0, bias_y = 0, mean_variance = 0;
    int count = 0;
    for (int i = 0; i < kDraws; ++i) {
      const auto fit = FitIn(Sampled(Lit(grey, e, picture.gradient, &random), noise, &random),
                             Aside(e), &picture);
      if (!fit) continue;
      ++count;
      const double dx = fit->ellipse.x_px - e.x_px, dy = fit->ellipse.y_px - e.y_px;
      const Eigen::Vector2d d(dx, dy);
      const Eigen::Matrix2d cov = fit->cov.topLeftCorner<2, 2>();
      square += d.dot(cov.inverse() * d);
      bias_x += dx;
      bias_y += dy;
      mean_variance += 0.5 * cov.trace();
      const double errors[5] = {dx, dy, fit->ellipse.semi_major_px - e.semi_major_px,
                                fit->ellipse.semi_minor_px - e.semi_minor_px,
                                fit->ellipse.angle_rad - e.angle_rad};
      for (int k = 0; k < 5; ++k) sums[k] += errors[k] * errors[k] / fit->cov(k, k);
    }
    ASSERT_EQ(count, kDraws) << contrast_over_noise;
    // Chi-square of 2 n degrees of freedom: 1 +- sqrt(1 / n), four of these.
    EXPECT_NEAR(square / (2 * count), 1.0, 4.0 / std::sqrt(count)) << contrast_over_noise;
    for (int k = 0; k < 5; ++k) {
      EXPECT_NEAR(std::sqrt(sums[k] / count), 1.0, 0.2) << k << ", " << contrast_over_noise;
    }
    const double of_mean = std::sqrt(mean_variance / count / count);
    EXPECT_NEAR(bias_x / count, 0.0, 4.0 * of_mean + 5e-4) << contrast_over_noise;
    EXPECT_NEAR(bias_y / count, 0.0, 4.0 * of_mean + 5e-4) << contrast_over_noise;
  }
}

TEST(DotFitTest, MomentsBeginNearTheDotHoweverItWasCutOut) {
  std::mt19937 random(7);
  const Ellipse e{23.4, 24.1, 7.0, 5.0, 0.6};
  const auto samples = Sampled(Blurred(e), {100.0, 0.2}, &random);
  WindowReader reader(ImageView16(samples.data(), kSize, kSize), 1);
  const GreyWindow window = reader.Read(0, 0, kSize - 1, kSize - 1);
  for (const double wrong : {-0.6, 0.0, 0.6}) {
    Ellipse start = e;
    start.x_px += 0.4;
    start.semi_major_px += wrong;
    start.semi_minor_px += wrong;
    const auto begun =
        DotFitter().Begin(window, {EllipseFrame::From(start), kBright, kDark}, kBlurPx);
    ASSERT_TRUE(begun);
    EXPECT_NEAR(begun->frame.center.x(), e.x_px, 0.05);
    EXPECT_NEAR(begun->frame.center.y(), e.y_px, 0.05);
    EXPECT_NEAR(begun->frame.ToEllipse().semi_major_px, e.semi_major_px, 0.15);
    EXPECT_NEAR(begun->frame.ToEllipse().semi_minor_px, e.semi_minor_px, 0.15);
  }
}

TEST(DotFitTest, AFlatWindowOrAWindowTooSmallGivesNothing) {
  const std::vector<std::uint16_t> flat(kSize * kSize, 500);
  const PictureModel picture = Model({100.0, 0.0});
  const Ellipse e{23.4, 24.1, 6.0, 6.0, 0.0};
  EXPECT_FALSE(FitIn(flat, e, &picture));
  EXPECT_FALSE(FitIn(flat, {-60.0, 24.0, 6.0, 6.0, 0.0}, &picture));
}

}  // namespace
}  // namespace videogrammetry
