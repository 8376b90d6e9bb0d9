#include "videogrammetry/recognition/model_fit.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "synthetic_picture.h"
#include "videogrammetry/recognition/model_pool.h"

namespace videogrammetry {
namespace {

using testing::Picture;

constexpr double kPsf = 0.7;
constexpr int kSize = 48;

/// A dot whose grey values are made without the fit's formulas.
struct Scene {
  Ellipse ellipse{23.5, 23.5, 6.0, 5.0, 0.6};
  double bright = 30000.0, dark = 3000.0, psf = kPsf;
  double light_x = 0.0, light_y = 0.0;  ///< relative change of the light a pixel
};

/// Mean over a pixel's 4 x 4 points of the ellipse blurred along x and y.
///
/// At a point the blur's integral is exact along x (a chord between two normal
/// distributions) and Simpson's rule along y over 5 psf to both sides: smooth
/// but for the ellipse's ends, so that steps of psf / 24 leave under 1e-4. Three
/// points of Gauss-Legendre a direction average a pixel to better than 1e-4.
double Coverage(const Ellipse& e, double psf, double px, double py) {
  const double c = std::cos(e.angle_rad), s = std::sin(e.angle_rad);
  const double ia = 1 / (e.semi_major_px * e.semi_major_px);
  const double ib = 1 / (e.semi_minor_px * e.semi_minor_px);
  const double xx = c * c * ia + s * s * ib, xy = c * s * (ia - ib), yy = s * s * ia + c * c * ib;
  const auto normal = [&](double t) { return 0.5 * std::erfc(-t / (psf * std::sqrt(2.0))); };
  // The ellipse reaches from -top to +top along y; t = top sin(w) takes out the chord's root.
  const double top = std::sqrt(xx / (xx * yy - xy * xy));
  constexpr int kSteps = 96;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double w = M_PI * ((i + 0.5) / kSteps - 0.5);
    const double y = top * std::sin(w);
    const double middle = -xy * y / xx;
    const double half = std::sqrt(std::max(0.0, (1 - yy * y * y) / xx + middle * middle));
    const double gap = (py - e.y_px - y) / psf, at = px - e.x_px;
    const double density = std::exp(-0.5 * gap * gap) / (psf * std::sqrt(2 * M_PI));
    const double chord = normal(at - middle + half) - normal(at - middle - half);
    sum += density * chord * top * std::cos(w) * M_PI / kSteps;
  }
  return sum;
}

std::vector<double> GreyValues(const Scene& scene) {
  const double root = 0.5 * std::sqrt(0.6);
  const double place[3] = {-root, 0.0, root}, weight[3] = {5 / 18.0, 8 / 18.0, 5 / 18.0};
  std::vector<double> grey(kSize * kSize);
  const Ellipse& e = scene.ellipse;
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      double cover = 0;
      const double far = std::hypot(x - e.x_px, y - e.y_px) - e.semi_major_px;
      for (int k = 0; k < 9 && far < 6 * scene.psf; ++k) {
        cover += weight[k / 3] * weight[k % 3] *
                 Coverage(e, scene.psf, x + place[k % 3], y + place[k / 3]);
      }
      const double light = 1 + scene.light_x * (x - e.x_px) + scene.light_y * (y - e.y_px);
      grey[static_cast<std::size_t>(y * kSize + x)] =
          light * (scene.dark + (scene.bright - scene.dark) * cover);
    }
  }
  return grey;
}

/// Rounded, with normal noise of standard deviation `noise` at white; the variance
/// at black is a fifth of that (shot noise over a constant part).
Picture<std::uint16_t> WithNoise(const Scene& scene, const std::vector<double>& grey, double noise,
                                 unsigned seed) {
  Picture<std::uint16_t> picture{kSize, kSize, {}};
  std::mt19937 random(seed);
  std::normal_distribution<double> unit(0.0, 1.0);
  for (const double g : grey) {
    const double share = (g - scene.dark) / (scene.bright - scene.dark);
    const double sigma = noise * std::sqrt(std::max(0.0, 0.2 + 0.8 * share));
    picture.pixels.push_back(static_cast<std::uint16_t>(std::lround(g + sigma * unit(random))));
  }
  return picture;
}

GreyNoise NoiseOf(const Scene& scene, double noise) {
  GreyNoise model;
  model.per_grey = 0.8 * noise * noise / (scene.bright - scene.dark);
  model.at_zero = 0.2 * noise * noise - model.per_grey * scene.dark;
  return model;
}

TargetEdge StartOf(const Scene& scene) {
  TargetEdge start;
  start.ellipse = scene.ellipse;
  start.ellipse.x_px += 0.03;
  start.ellipse.y_px -= 0.02;
  start.ellipse.semi_major_px += 0.03;
  start.inside = 0.99 * scene.bright;
  start.outside = 1.02 * scene.dark;
  start.width_px = std::sqrt(scene.psf * scene.psf + 2.0 / 12.0);
  return start;
}

TargetEdge Refined(const Picture<std::uint16_t>& picture, const TargetEdge& start) {
  TargetEdge edge = start;
  RefineByModel(SignedImage<std::uint16_t>(picture.view(), 1), {&edge});
  return edge;
}

TEST(ModelFitTest, HasNoBiasWithoutNoise) {
  for (const double aspect : {0.5, 0.75, 1.0}) {
    for (int k = 0; k < 12; ++k) {
      Scene scene;
      scene.ellipse = {23 + 0.083 * k, 24 - 0.29 * k + std::floor(0.29 * k), 6.0, 6.0 * aspect,
                       0.26 * k};
      const TargetEdge edge = Refined(WithNoise(scene, GreyValues(scene), 0.0, 1), StartOf(scene));
      EXPECT_LT(std::hypot(edge.ellipse.x_px - scene.ellipse.x_px,
                           edge.ellipse.y_px - scene.ellipse.y_px),
                0.002)
          << aspect << " " << k;
      EXPECT_NE(edge.ellipse.x_px, StartOf(scene).ellipse.x_px);
      // At the ends of an ellipse of 6 x 3 px the curvature is 0.67 / px: k s = 0.5,
      // and what Eq. (2) leaves out is of the order of s (k s)^3 / 8.
      const double limit = aspect < 0.6 ? 0.02 : 0.004;
      EXPECT_NEAR(edge.ellipse.semi_major_px, scene.ellipse.semi_major_px, limit) << aspect;
      EXPECT_NEAR(edge.ellipse.semi_minor_px, scene.ellipse.semi_minor_px, limit) << aspect;
    }
  }
}

TEST(ModelFitTest, MeasuresSmallDots) {
  for (int k = 0; k < 10; ++k) {
    Scene scene;
    scene.ellipse = {23.1 + 0.1 * k, 23.7 - 0.17 * k, 2.6, 2.4, 0.3 * k};
    const TargetEdge edge = Refined(WithNoise(scene, GreyValues(scene), 0.0, 1), StartOf(scene));
    EXPECT_NE(edge.ellipse.x_px, StartOf(scene).ellipse.x_px) << k;
    EXPECT_NEAR(edge.ellipse.x_px, scene.ellipse.x_px, 0.002) << k;
    EXPECT_NEAR(edge.ellipse.y_px, scene.ellipse.y_px, 0.002) << k;
    EXPECT_NEAR(edge.ellipse.semi_minor_px, scene.ellipse.semi_minor_px, 0.03) << k;
  }
}

TEST(ModelFitTest, FollowsLightAndGlare) {
  Scene scene;
  // 2 % over the radius, the priors' standard deviation: of its shift of
  // 0.02 s / (2 phi(0)) = 0.02 px without gradients in the model a tenth may be left.
  scene.light_x = 0.02 / 6;
  const TargetEdge edge = Refined(WithNoise(scene, GreyValues(scene), 270.0, 3), StartOf(scene));
  const double sigma = std::sqrt(edge.cov(0, 0));
  EXPECT_NEAR(edge.ellipse.x_px, scene.ellipse.x_px, 0.002 + 4 * sigma);
  // Light that is added: 20 % of the contrast a radius, on both sides alike.
  auto grey = GreyValues(Scene{});
  for (int i = 0; i < kSize * kSize; ++i) {
    grey[static_cast<std::size_t>(i)] += 5400.0 / 6 * (i % kSize - 23.5) + 20000;
  }
  TargetEdge start = StartOf(Scene{});
  start.inside += 20000;
  start.outside += 20000;
  start.inside_glare = start.outside_glare = 5400.0;
  Picture<std::uint16_t> picture{kSize, kSize, {}};
  for (const double g : grey) {
    picture.pixels.push_back(static_cast<std::uint16_t>(std::clamp(g, 0.0, 65535.0)));
  }
  const TargetEdge glare = Refined(picture, start);
  EXPECT_NEAR(glare.ellipse.x_px, Scene{}.ellipse.x_px, 0.005);
  EXPECT_GT(glare.cov(0, 0), edge.cov(0, 0)) << "glare that is curved must be counted";
}

/// Cramer and Rao's bound for the centre, everything else unknown but blur and
/// gradients, from the pixels that the fit may use: numerical derivatives of
/// the scene's own grey values.
double BoundOfX(const Scene& scene, double noise) {
  const Ellipse& e = scene.ellipse;
  const double reach = 3.0 * std::sqrt(kPsf * kPsf + 1 / 12.0) + 1.5;
  const auto grey = GreyValues(scene);
  const std::vector<std::function<void(Scene*, double)>> vary = {
      [](Scene* s, double h) { s->ellipse.x_px += h; },
      [](Scene* s, double h) { s->ellipse.y_px += h; },
      [](Scene* s, double h) { s->ellipse.semi_major_px += h; },
      [](Scene* s, double h) { s->ellipse.semi_minor_px += h; },
      [](Scene* s, double h) { s->ellipse.angle_rad += h; },
      [](Scene* s, double h) { s->bright += 1e3 * h; },
      [](Scene* s, double h) { s->dark += 1e3 * h; }};
  const auto n = static_cast<Eigen::Index>(vary.size());
  Eigen::MatrixXd rows(kSize * kSize, n);
  for (Eigen::Index j = 0; j < n; ++j) {
    constexpr double kStep = 1e-2;
    Scene less = scene, more = scene;
    vary[static_cast<std::size_t>(j)](&less, -kStep);
    vary[static_cast<std::size_t>(j)](&more, kStep);
    const auto low = GreyValues(less), high = GreyValues(more);
    for (Eigen::Index i = 0; i < rows.rows(); ++i) {
      const auto k = static_cast<std::size_t>(i);
      rows(i, j) =
          (high[k] - low[k]) / (2 * kStep) / std::sqrt(NoiseOf(scene, noise).Variance(grey[k]));
      const double far = std::hypot(static_cast<double>(i % kSize) - e.x_px,
                                    static_cast<double>(i / kSize) - e.y_px);
      if (far > e.semi_major_px + reach) rows(i, j) = 0;
    }
  }
  const Eigen::MatrixXd information = rows.transpose() * rows;
  return std::sqrt(information.ldlt().solve(Eigen::MatrixXd::Identity(n, n))(0, 0));
}

/// Errors over the predicted deviations, and of x itself, over noisy copies.
struct Scatter {
  Eigen::Array<double, 5, 1> normalised = Eigen::Array<double, 5, 1>::Zero();
  double x_px = 0.0;
};

Scatter MonteCarlo(const Scene& scene, double noise, int count) {
  const auto grey = GreyValues(scene);
  PictureModel model;
  model.noise = NoiseOf(scene, noise);
  model.blur_px = std::sqrt(kPsf * kPsf + 1 / 12.0);
  model.blur_sigma_px = 0.003;
  model.gradient = 0.003;  // even light, as the bound has it
  Scatter scatter;
  for (int k = 0; k < count; ++k) {
    const auto picture = WithNoise(scene, grey, noise, static_cast<unsigned>(k + 1));
    const auto fit =
        FitModel(SignedImage<std::uint16_t>(picture.view(), 1), StartOf(scene), &model);
    if (!fit) {
      ADD_FAILURE() << "seed " << k + 1;
      continue;
    }
    const Ellipse &e = fit->ellipse, &t = scene.ellipse;
    Eigen::Array<double, 5, 1> error;
    error << e.x_px - t.x_px, e.y_px - t.y_px, e.semi_major_px - t.semi_major_px,
        e.semi_minor_px - t.semi_minor_px, std::remainder(e.angle_rad - t.angle_rad, M_PI);
    scatter.normalised += error.square() / fit->cov.diagonal().array() / count;
    scatter.x_px += error[0] * error[0] / count;
  }
  scatter.normalised = scatter.normalised.sqrt();
  scatter.x_px = std::sqrt(scatter.x_px);
  return scatter;
}

TEST(ModelFitTest, ReachesTheBoundAndKnowsIt) {
  constexpr int kCount = 400;  // an RMS scatters by 1 / sqrt(2 * 400) = 3.5 %
  for (const double snr : {75.0, 25.0, 13.0}) {
    Scene scene;
    scene.ellipse.semi_minor_px = 4.5;
    const double noise = (scene.bright - scene.dark) / snr;
    const Scatter scatter = MonteCarlo(scene, noise, kCount);
    EXPECT_LT(scatter.x_px, 1.15 * 1.035 * BoundOfX(scene, noise)) << snr;
    EXPECT_GT(scatter.x_px, 0.85 * BoundOfX(scene, noise)) << snr;
    for (int i = 0; i < 5; ++i) {
      EXPECT_GT(scatter.normalised[i], 0.8 - 0.035) << snr << ", " << i;
      EXPECT_LT(scatter.normalised[i], 1.2 + 0.035) << snr << ", " << i;
    }
  }
}

TEST(ModelFitTest, PoolsNoiseAndBlurOfAPicture) {
  std::vector<ModelFit> fits;
  for (int k = 0; k < 20; ++k) {
    Scene scene;
    scene.ellipse = {23.1 + 0.04 * k, 23.7 - 0.07 * k, 7.0, 6.0, 0.3 * k};
    const auto picture = WithNoise(scene, GreyValues(scene), 600.0, static_cast<unsigned>(k));
    const auto fit =
        FitModel(SignedImage<std::uint16_t>(picture.view(), 1), StartOf(scene), nullptr);
    ASSERT_TRUE(fit.has_value()) << k;
    fits.push_back(*fit);
  }
  const auto pooled = PoolModels(fits);
  ASSERT_TRUE(pooled.has_value());
  // 20 dots of 50 pixels and more a plateau: 1 / sqrt(2 * 1000), and a median's 1.25.
  EXPECT_NEAR(pooled->noise.Variance(30000.0) / (600.0 * 600.0), 1.0, 0.15);
  EXPECT_NEAR(pooled->noise.Variance(3000.0) / (0.2 * 600.0 * 600.0), 1.0, 0.15);
  EXPECT_NEAR(pooled->blur_px, std::sqrt(kPsf * kPsf + 1 / 12.0), 0.01);
  EXPECT_FALSE(PoolModels({}).has_value());
}

TEST(ModelFitTest, PoolsTheEvennessOfLight) {
  for (const double truth : {0.005, 0.02, 0.05}) {
    std::mt19937 random(7);
    std::normal_distribution<double> unit(0.0, 1.0);
    std::vector<ModelFit> fits(60);
    for (ModelFit& fit : fits) {
      fit.gradient_variance = 0.01 * 0.01;
      const double sigma = std::hypot(truth, 0.01);
      fit.gradient = sigma * Eigen::Vector2d(unit(random), unit(random));
    }
    // t^2 + noise is known to sqrt(2 / 120) = 13 %; 0.005^2 + 0.01^2 to 1.6e-5, three
    // times which is 0.005 to 0.0086 and below.
    EXPECT_NEAR(PoolGradient(fits), truth, std::max(0.0036, 0.3 * truth)) << truth;
  }
  EXPECT_NEAR(PoolGradient({}), 0.02, 0.001) << "no dots: what is usual";
}

TEST(ModelFitTest, WhatCannotBeFittedStaysAsItWas) {
  const Scene scene;
  TargetEdge start = StartOf(scene);
  start.ellipse.x_px += 2.0;  // beyond what a fit may leave its start by
  start.cov.setIdentity();
  const TargetEdge edge = Refined(WithNoise(scene, GreyValues(scene), 0.0, 1), start);
  EXPECT_EQ(edge.ellipse.x_px, start.ellipse.x_px);
  EXPECT_EQ(edge.cov, start.cov);
  const std::vector<std::uint16_t> flat(kSize * kSize, 1000);
  TargetEdge nothing = start;
  RefineByModel(SignedImage<std::uint16_t>(ImageView16(flat.data(), kSize, kSize), 1), {&nothing});
  EXPECT_EQ(nothing.ellipse.x_px, start.ellipse.x_px);
  RefineByModel(SignedImage<std::uint16_t>(ImageView16(flat.data(), kSize, kSize), 1), {});
}

}  // namespace
}  // namespace videogrammetry
