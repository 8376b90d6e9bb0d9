#include "videogrammetry/rendering/render.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "scenes.h"

namespace videogrammetry {
namespace {

constexpr int kSize = 64;

/// A white dot on black before a black background: nothing but the dot is bright.
SceneTarget LoneDot(const TargetPose& pose, double radius_mm) {
  SceneTarget target;
  target.pose = pose;
  target.radius_mm = radius_mm;
  target.sticker_mm = 1.6 * radius_mm;
  target.white = 0.9;
  target.black = 0.1;
  return target;
}

Renderer Plain(double psf_px, const OrientedCamera& camera) {
  Background background;
  background.level = 0.1;
  Sensor sensor;
  sensor.psf_sigma_px = psf_px;
  return Renderer(camera, background, Illumination{}, sensor);
}

class LoneDotTest : public testing::TestWithParam<double> {};

TEST_P(LoneDotTest, CentroidAndAreaAreTheTruth) {
  const double psf = GetParam();
  const auto camera = scenes::Pinhole(kSize);
  const Renderer renderer = Plain(psf, camera);
  double worst = 0, worst_area = 0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  int count = 0;
  for (const double radius_px : {4.0, 6.3, 10.0}) {
    for (int k = 0; k < 12; ++k, ++count) {
      const double z = 12000, mm = z / 2650;
      const auto pose =
          scenes::Before((0.083 * k - 0.4) * mm, (0.31 * k - 1.7) * mm, z, 0.065 * k, 0.5 * k);
      const SceneTarget dot = LoneDot(pose, radius_px * mm);
      const auto moments = scenes::MomentsOf(renderer.Light({dot}), kSize, 0.1, 0.9);
      const Ellipse truth = *renderer.Truth({dot})[0].ellipse;
      const Eigen::Vector2d error = moments.center - Eigen::Vector2d(truth.x_px, truth.y_px);
      const double area = std::numbers::pi * truth.semi_major_px * truth.semi_minor_px;
      worst = std::max(worst, error.norm());
      worst_area = std::max(worst_area, std::abs(moments.area / area - 1));
      mean += error;
    }
  }
  // A crossed cell's share errs by less than 1 / (8 * 8^2) = 0.002 px^2 where the border turns
  // in it, of any sign; n = 4 r crossed pixels at the distance r move the centroid of pi r^2 px
  // by 0.002 r sqrt(4 r / 2) / (pi r^2) = 0.0009 / sqrt(r): 0.0005 px at 4 px. The Gaussian cut
  // off at 4.3 sigma and single precision are far below.
  // Without a lens the sum over pixels is no integral: a border of 4 ... 10 px radius samples
  // x within pixels, of variance 1/12, 8 r times: sqrt(8 r / 12 / 4) / (pi r^2) = 0.03 px at
  // most, less for a smooth border; a lens of 0.3 px lets exp(-2 (0.3 pi)^2) = 0.17 of it pass.
  const double bound = psf > 0.3 ? 5e-4 : psf > 0 ? 2e-3 : 1e-2;
  EXPECT_LT(worst, bound) << psf;
  EXPECT_LT((mean / count).norm(), 1e-4 + bound / 5) << psf;
  EXPECT_LT(worst_area, 5e-4) << psf;
}

INSTANTIATE_TEST_SUITE_P(Psf, LoneDotTest, testing::Values(0.0, 0.3, 0.6, 0.7, 0.8, 1.5));

TEST(Renderer, EdgeSpreadIsThatOfLensAndPixel) {
  const auto camera = scenes::Pinhole(kSize);
  for (const double psf : {0.3, 0.6, 0.8}) {
    const Renderer renderer = Plain(psf, camera);
    for (const double shift : {0.0, 0.21, 0.5}) {
      // The square sticker's upright border far from its corners is a straight edge.
      SceneTarget target = LoneDot(scenes::Before(0, 0, 2650), 1.0);
      target.sticker_mm = 20 + shift;
      target.white_on_black = false;
      target.black = 0.9;  // all of it bright
      const auto light = renderer.Light({target});
      const double edge = 31.5 + 20 + shift;
      for (int x = 48; x < 56; ++x) {
        // The Gaussian's integral meaned over the pixel; Simpson on 200 parts.
        double sum = 0;
        for (int k = 0; k <= 200; ++k) {
          const double at = edge - (x - 0.5 + k / 200.0);
          const double weight = k == 0 || k == 200 ? 1 : (k % 2 == 1 ? 4 : 2);
          sum += weight * 0.5 * std::erfc(-at / (psf * std::numbers::sqrt2));
        }
        const double exact = 0.1 + 0.8 * sum / 600;
        EXPECT_NEAR(light[32 * kSize + x], exact, 0.8 * 3e-3) << psf << " " << shift << " " << x;
      }
    }
  }
}

TEST(Renderer, MovesBetweenFramesAsTheTruth) {
  const Renderer renderer = Plain(0.7, scenes::Pinhole(kSize));
  const double mm = 12000 / 2650.0;
  const auto at = [&](double x_px) {
    const SceneTarget dot = LoneDot(scenes::Before(x_px * mm, 0, 12000), 6 * mm);
    return scenes::MomentsOf(renderer.Light({dot}), kSize, 0.1, 0.9).center;
  };
  for (const double way : {0.05, 0.5, 3.37}) {
    EXPECT_NEAR((at(way) - at(0)).x(), way, 1e-3);
    EXPECT_NEAR((at(way) - at(0)).y(), 0, 1e-3);
  }
}

TEST(Renderer, MotionBlurSpreadsAndKeepsLight) {
  const Renderer renderer = Plain(0.7, scenes::Pinhole(kSize));
  const double mm = 12000 / 2650.0;
  SceneTarget dot = LoneDot(scenes::Before(-2 * mm, 0, 12000), 6 * mm);
  const SceneTarget sharp = LoneDot(scenes::Before(0, 0, 12000), 6 * mm);
  dot.end_pose = scenes::Before(2 * mm, 0, 12000);
  const auto blurred = renderer.Light({dot}), still = renderer.Light({sharp});
  const auto a = scenes::MomentsOf(blurred, kSize, 0.1, 0.9);
  const auto b = scenes::MomentsOf(still, kSize, 0.1, 0.9);
  EXPECT_NEAR((a.center - b.center).norm(), 0, 1e-3);
  EXPECT_NEAR(a.area / b.area, 1, 1e-3);
  const auto spread = [&](const std::vector<float>& light) {
    double sum = 0, squares = 0;
    for (std::size_t i = 0; i < light.size(); ++i) {
      const double x = static_cast<double>(i % kSize) - 31.5;
      sum += light[i] - 0.1;
      squares += (light[i] - 0.1) * x * x;
    }
    return squares / sum;
  };
  // A box of 4 px adds 16 / 12 to the second moment, 16 positions 1 / 16^2 less.
  EXPECT_NEAR(spread(blurred) - spread(still), 16.0 / 12 * (1 - 1.0 / 256), 0.01);
}

TEST(Renderer, NearerTargetsHideFartherOnes) {
  const Renderer renderer = Plain(0.7, scenes::Pinhole(kSize));
  const SceneTarget far_dot = LoneDot(scenes::Before(0, 0, 12000), 40);
  SceneTarget blank = LoneDot(scenes::Before(0, 0, 6000), 40);
  blank.white = blank.black = 0.1;
  const auto alone = renderer.Light({blank});
  for (const auto& targets : {std::vector{far_dot, blank}, std::vector{blank, far_dot}}) {
    const auto light = renderer.Light(targets);
    for (std::size_t i = 0; i < light.size(); ++i) ASSERT_NEAR(light[i], alone[i], 1e-6);
  }
}

TEST(Renderer, LightAndGradients) {
  Background background;
  background.level = 0.5;
  Illumination light;
  light.gradient = {0.4, -0.2};
  const Renderer renderer(scenes::Pinhole(kSize), background, light, Sensor{});
  const auto picture = renderer.Light({});
  EXPECT_NEAR(picture[0], 0.5 * (1 - 0.2 * 63 / 64.0 + 0.1 * 63 / 64.0), 1e-6);
  EXPECT_NEAR(picture[kSize * kSize - 1], 0.5 * (1 + 0.1 * 63 / 64.0), 1e-6);
  SceneTarget sheet = LoneDot(scenes::Before(0, 0, 2650), 5);
  sheet.white = sheet.black = 0.5;
  sheet.sticker_mm = 10;
  sheet.gradient = {0.1, 0.0};  // 2 % a pixel along x
  const auto shaded = Renderer(scenes::Pinhole(kSize), background, {}, {}).Light({sheet});
  EXPECT_NEAR(shaded[32 * kSize + 36] - shaded[32 * kSize + 28], 0.5 * 0.02 * 8, 1e-5);
}

TEST(Renderer, SpotsAddTheirLight) {
  Background background;
  background.level = 0.1;
  background.spots = {{30.3, 20.7, 2.0, 0.6}};
  const auto light = Renderer(scenes::Pinhole(kSize), background, {}, {}).Light({});
  double sum = 0;
  for (const float v : light) sum += v - 0.1;
  EXPECT_NEAR(sum, 2 * std::numbers::pi * 4 * 0.6, 1e-3);
}

TEST(Renderer, NamesWhatIsImpossible) {
  const auto camera = scenes::Pinhole(kSize);
  const auto message = [](auto&& action) -> std::string {
    try {
      action();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  const auto sensor = [&](auto&& change) {
    Sensor s;
    change(s);
    return message([&] { Renderer(camera, {}, {}, s); });
  };
  EXPECT_NE(sensor([](Sensor& s) { s.read_noise = -1; }).find("read_noise"), std::string::npos);
  EXPECT_NE(sensor([](Sensor& s) { s.shot_noise_gain = -1; }).find("shot_noise"),
            std::string::npos);
  EXPECT_NE(sensor([](Sensor& s) { s.psf_sigma_px = -0.1; }).find("psf_sigma"), std::string::npos);
  EXPECT_NE(sensor([](Sensor& s) { s.bit_depth = 9; }).find("bit_depth"), std::string::npos);
  const Renderer renderer = Plain(0.7, camera);
  const auto target = [&](auto&& change) {
    SceneTarget t = LoneDot(scenes::Before(0, 0, 12000), 20);
    change(t);
    return message([&] { renderer.Light({t}); });
  };
  EXPECT_EQ(target([](SceneTarget&) {}), "");
  EXPECT_NE(target([](SceneTarget& t) { t.radius_mm = 0; }).find("radius_mm"), std::string::npos);
  EXPECT_NE(target([](SceneTarget& t) { t.pose.normal *= 2; }).find("normal"), std::string::npos);
  EXPECT_NE(target([](SceneTarget& t) { t.num_bits = 40; }).find("num_bits"), std::string::npos);
  EXPECT_NE(target([](SceneTarget& t) { t.white = 1.5; }).find("white"), std::string::npos);
  EXPECT_NE(
      target([](SceneTarget& t) { t.end_pose = scenes::Before(2000, 0, 12000); }).find("end_pose"),
      std::string::npos);
  EXPECT_EQ(target([](SceneTarget& t) { t.pose.center_mm.z() = -12000; }), "");
  std::vector<std::uint16_t> samples(kSize * kSize);
  EXPECT_NE(message([&] { renderer.Render({}, 0, samples.data()); }).find("bit_depth"),
            std::string::npos);
}

}  // namespace
}  // namespace videogrammetry
