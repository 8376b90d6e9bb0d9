#include "videogrammetry/rendering/local_map.h"

#include <gtest/gtest.h>

#include "scenes.h"

namespace videogrammetry {
namespace {

/// Largest distance, in px of the picture, of the lattice from the exact chain.
double LargestError(const OrientedCamera& camera, const TargetPose& pose, double radius_mm,
                    int reach_px, int scale) {
  const Eigen::Vector2d center = *ProjectFromWorld(camera, pose.center_mm);
  const int x = static_cast<int>(center.x()), y = static_cast<int>(center.y());
  const PixelWindow window{x - reach_px, y - reach_px, x + reach_px + 3, y + reach_px + 1};
  const LocalMap map(camera, pose, radius_mm);
  const PlaneLattice lattice = map.Over(window, scale);
  EXPECT_EQ(lattice.columns, window.width() * scale + 1);
  double largest = 0;
  const double px_per_radius = camera.camera.f_px() * radius_mm / pose.center_mm.z();
  for (int j = 0; j < lattice.rows; ++j) {
    for (int i = 0; i < lattice.columns; ++i) {
      const auto exact = map.At({window.x0 - 0.5 + static_cast<double>(i) / scale,
                                 window.y0 - 0.5 + static_cast<double>(j) / scale});
      const std::size_t k = static_cast<std::size_t>(j) * lattice.columns + i;
      largest = std::max(largest, px_per_radius * std::hypot(lattice.u[k] - exact->x(),
                                                             lattice.v[k] - exact->y()));
    }
  }
  return largest;
}

TEST(LocalMap, AgreesWithTheExactRaysOfThePapersCamera) {
  for (const auto direction : {DistortionDirection::kMeasured, DistortionDirection::kIdeal}) {
    const auto camera = scenes::PaperCamera(direction);
    for (const double tilt : {0.0, 0.8, 1.2}) {
      const auto pose = scenes::Before(1500, -1400, 12000, tilt, 0.7);
      // Single precision of coordinates up to 5 radii of 10 px: 5 * 10 * 2^-24 * 3 = 1e-5 px.
      EXPECT_LT(LargestError(camera, pose, 45, 40, 2), 3e-5) << tilt;
      EXPECT_LT(LargestError(camera, pose, 45, 37, 1), 3e-5) << tilt;
    }
  }
}

TEST(LocalMap, BoundOfAWideAngleNearby) {
  auto camera = scenes::Pinhole(1024, 500);
  camera.camera.interior[kA1] = -2e-7;
  const double tilt = 1.05;
  const auto pose = scenes::Before(200, 100, 400, tilt, 0.3);
  // D a^3 / (9 sqrt 3) with a = 4 px, D = 6 (tan t / f)^2 px^-2 and t the angle of normal and
  // ray, and the same again for the other coordinate and for A1's third derivative:
  const Eigen::Vector3d ray = pose.center_mm.normalized();
  const double t = std::acos(-pose.normal.dot(ray)) + 40.0 / 500;  // at the window's rim
  const double bound = 64 / (9 * std::sqrt(3)) * 6 * std::pow(std::tan(t) / 500, 2);
  EXPECT_LT(LargestError(camera, pose, 6, 40, 2), 2 * bound);
  EXPECT_LT(bound, 5e-3);
}

}  // namespace
}  // namespace videogrammetry
