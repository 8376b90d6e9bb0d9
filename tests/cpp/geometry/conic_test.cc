#include "videogrammetry/geometry/conic.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace videogrammetry {
namespace {

TEST(Conic, EllipseComesBack) {
  for (const double angle : {0.0, 0.4, 1.5, 2.9}) {
    const Ellipse ellipse{812.25, 340.5, 17.5, 9.25, angle};
    // Any scale and sign of the matrix is the same conic.
    for (const double scale : {1.0, -3.0, 1e-4}) {
      const auto back = EllipseFromConic(scale * ConicFromEllipse(ellipse));
      ASSERT_TRUE(back);
      // The matrix's corner is of the order x^2 / b^2 = 1e4: 12 digits remain.
      EXPECT_NEAR(back->x_px, ellipse.x_px, 1e-9);
      EXPECT_NEAR(back->y_px, ellipse.y_px, 1e-9);
      EXPECT_NEAR(back->semi_major_px, ellipse.semi_major_px, 1e-9);
      EXPECT_NEAR(back->semi_minor_px, ellipse.semi_minor_px, 1e-9);
      EXPECT_NEAR(std::sin(back->angle_rad - ellipse.angle_rad), 0.0, 1e-10);
      EXPECT_GE(back->angle_rad, 0.0);
      EXPECT_LT(back->angle_rad, std::numbers::pi);
    }
  }
}

TEST(Conic, PointsOfTheEllipseLieOnIt) {
  const Ellipse ellipse{10, 20, 6, 3, 0.7};
  const Eigen::Matrix3d conic = ConicFromEllipse(ellipse);
  for (int i = 0; i < 12; ++i) {
    const double t = i * std::numbers::pi / 6;
    const double u = 6 * std::cos(t), v = 3 * std::sin(t);
    const Eigen::Vector3d point(10 + u * std::cos(0.7) - v * std::sin(0.7),
                                20 + u * std::sin(0.7) + v * std::cos(0.7), 1);
    EXPECT_NEAR(point.dot(conic * point), 0.0, 1e-12);
  }
  EXPECT_LT(Eigen::Vector3d(10, 20, 1).dot(conic * Eigen::Vector3d(10, 20, 1)), 0.0);
}

TEST(Conic, OtherConicsAreNoEllipse) {
  EXPECT_FALSE(EllipseFromConic(Eigen::Vector3d(1, -1, -1).asDiagonal()));  // hyperbola
  EXPECT_FALSE(EllipseFromConic(Eigen::Vector3d(1, 0, -1).asDiagonal()));   // two lines
  EXPECT_FALSE(EllipseFromConic(Eigen::Vector3d(1, 1, 1).asDiagonal()));    // imaginary
}

}  // namespace
}  // namespace videogrammetry
