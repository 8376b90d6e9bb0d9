#include "videogrammetry/geometry/refraction.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <random>

#include "videogrammetry/geometry/rig.h"

namespace videogrammetry {
namespace {

Eigen::Vector3d Uniform(std::mt19937* random, double reach) {
  std::uniform_real_distribution<double> u(-reach, reach);
  return {u(*random), u(*random), u(*random)};
}

struct Case {
  FlatInterface interface;
  Eigen::Vector3d center, point;
};

/// A camera about a metre before a tilted window, a point in the fluid.
Case MakeCase(unsigned seed, bool glass) {
  std::mt19937 random(seed);
  Case c;
  c.interface.normal = (Eigen::Vector3d::UnitZ() + Uniform(&random, 0.3)).normalized();
  c.interface.distance_mm = 250.0;
  if (glass) {
    c.interface.glass_index = 1.5;
    c.interface.glass_thickness_mm = 12.0;
  }
  c.center = 1100.0 * c.interface.normal + Uniform(&random, 500);
  c.point = 60.0 * c.interface.normal + Uniform(&random, 150);
  return c;
}

Eigen::Vector3d Seen(const Case& c) { return *SeenThrough(c.interface, c.point, c.center); }

/// Sine of the angle between a way and the normal.
double Sine(const Eigen::Vector3d& way, const Eigen::Vector3d& normal) {
  return way.cross(normal).norm() / way.norm();
}

TEST(Refraction, SnellIsSatisfied) {
  for (unsigned seed = 1; seed <= 50; ++seed) {
    const Case c = MakeCase(seed, false);
    const Eigen::Vector3d& n = c.interface.normal;
    const Eigen::Vector3d s = Seen(c);
    EXPECT_NEAR(n.dot(s), c.interface.distance_mm, 1e-10);
    EXPECT_NEAR(Sine(s - c.center, n), c.interface.fluid_index * Sine(c.point - s, n), 1e-12);
    // All in the plane of incidence.
    EXPECT_NEAR((s - c.center).cross(c.point - s).dot(n) / (c.point - s).norm(), 0, 1e-9);
  }
}

// Forward and backward are written independently: the refracted ray through the
// seen point must meet the object point, glass included.
TEST(Refraction, TheRayMeetsThePoint) {
  for (unsigned seed = 1; seed <= 50; ++seed) {
    for (const bool glass : {false, true}) {
      const Case c = MakeCase(seed, glass);
      const auto ray = RefractRay(c.interface, c.center, Seen(c) - c.center);
      ASSERT_TRUE(ray);
      EXPECT_NEAR(ray->direction.norm(), 1.0, 1e-14);
      EXPECT_NEAR(c.interface.normal.dot(ray->origin_mm),
                  c.interface.distance_mm - c.interface.glass_thickness_mm, 1e-10);
      EXPECT_LT((c.point - ray->origin_mm).cross(ray->direction).norm(), 1e-9) << seed;
    }
  }
}

TEST(Refraction, NearlyGrazingSight) {
  // 89.9 degrees in air: 1e5 mm along the surface at 175 mm height.
  FlatInterface interface;
  const Eigen::Vector3d center(0, 0, 175), point(1e5, 0, -30);
  const Eigen::Vector3d s = *SeenThrough(interface, point, center);
  EXPECT_NEAR(Sine(s - center, interface.normal),
              interface.fluid_index * Sine(point - s, interface.normal), 1e-12);
}

TEST(Refraction, IndexOneIsNoRefraction) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Case c = MakeCase(seed, true);
    c.interface.fluid_index = c.interface.glass_index = 1.0;
    const OrientedCamera straight{{1000, 1000, {}, 300.0},
                                  {Eigen::Matrix3d(RotationFromVector({M_PI, 0, 0})), {0, 0, 0}}};
    OrientedCamera camera = straight;
    camera.camera.interior << 2000, 3, -4, 1e-8, 0, 0, 1e-7, 0, 0, 0;
    camera.cam_from_world.translation_mm = -(camera.cam_from_world.rotation * c.center);
    OrientedCamera through = camera;
    through.interface = c.interface;
    OrientedJacobians a, b;
    const auto plain = ProjectFromWorld(camera, c.point, &a);
    const auto seen = ProjectFromWorld(through, c.point, &b);
    ASSERT_TRUE(plain && seen);
    EXPECT_LT((*plain - *seen).norm(), 1e-9);  // pixels of 1e3 are good to 1e-10
    EXPECT_LT((a.by_point - b.by_point).norm(), 1e-9 * a.by_point.norm());
    EXPECT_LT((a.by_camera - b.by_camera).norm(), 1e-9 * a.by_camera.norm());
    // Written as directions: u is exact.
    const auto ray = RefractRay(c.interface, c.center, c.point - c.center);
    EXPECT_LT((ray->direction - (c.point - c.center).normalized()).norm(), 1e-14);
  }
}

TEST(Refraction, PointsInFrontAreSeenStraight) {
  const Case c = MakeCase(3, true);
  const Eigen::Vector3d point = 300.0 * c.interface.normal;
  RefractionJacobians j;
  EXPECT_EQ(*SeenThrough(c.interface, point, c.center, &j), point);
  EXPECT_TRUE(j.by_point.isIdentity(0) && j.by_center.isZero(0) && j.by_normal.isZero(0));
  EXPECT_FALSE(SeenThrough(c.interface, c.point, 100.0 * c.interface.normal));
  EXPECT_FALSE(RefractRay(c.interface, c.center, c.interface.normal));
}

// Central differences with Richardson's step: on values of 1e3 mm rounding is
// 1e-13 / h; with h = 1 mm (1e-3 of the normal) errors stay under 1e-9.
template <typename Change>
Eigen::VectorXd Numerical(const Change& change, double h) {
  const Eigen::VectorXd d1 = (change(h) - change(-h)) / (2 * h);
  const Eigen::VectorXd d2 = (change(2 * h) - change(-2 * h)) / (4 * h);
  return (4 * d1 - d2) / 3;
}

TEST(Refraction, Derivatives) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    Case c = MakeCase(seed, seed % 2 == 0);
    if (seed == 5) c.point = c.center - 1000.0 * c.interface.normal;  // perpendicular
    if (seed == 6) c.point = 244.0 * c.interface.normal + Eigen::Vector3d(5, 0, 0);  // in the glass
    RefractionJacobians j;
    ASSERT_TRUE(SeenThrough(c.interface, c.point, c.center, &j));
    for (int k = 0; k < 3; ++k) {
      auto moved = [&](auto change) {
        return [&c, change](double h) {
          Case t = c;
          change(&t, h);
          return Eigen::VectorXd(Seen(t));
        };
      };
      const Eigen::Vector3d unit = Eigen::Vector3d::Unit(k);
      const double h = 0.2;
      EXPECT_LT((j.by_point.col(k) -
                 Numerical(moved([&](Case* t, double s) { t->point += s * unit; }), h))
                    .norm(),
                1e-8)
          << seed;
      EXPECT_LT((j.by_center.col(k) -
                 Numerical(moved([&](Case* t, double s) { t->center += s * unit; }), h))
                    .norm(),
                1e-8)
          << seed;
      const Eigen::Vector3d n = c.interface.normal;
      const Eigen::Vector3d tangent = n.cross(unit);
      auto turn = [&](Case* t, double s) { t->interface.normal = (n + s * tangent).normalized(); };
      const Eigen::VectorXd turned = Numerical(moved(turn), 1e-4);
      EXPECT_LT((j.by_normal * tangent - turned).norm(), 1e-6 * turned.norm()) << seed;
    }
    auto shift = [&](double s) {
      Case t = c;
      t.interface.distance_mm += s;
      return Eigen::VectorXd(Seen(t));
    };
    EXPECT_LT((j.by_distance - Numerical(shift, 0.2)).norm(), 1e-8) << seed;
  }
}

TEST(Refraction, DerivativesOfARay) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const Case c = MakeCase(seed, seed % 2 == 0);
    const Eigen::Vector3d direction = (c.point - c.center) / 700.0;
    RayJacobians j;
    ASSERT_TRUE(RefractRay(c.interface, c.center, direction, &j));
    for (int k = 0; k < 3; ++k) {
      auto at = [&](double h) {
        const Ray ray =
            *RefractRay(c.interface, c.center, direction + h * Eigen::Vector3d::Unit(k));
        Eigen::VectorXd both(6);
        both << ray.origin_mm, ray.direction;
        return both;
      };
      const Eigen::VectorXd numerical = Numerical(at, 1e-3);
      EXPECT_LT((j.origin_by_direction.col(k) - numerical.head<3>()).norm(), 1e-6);
      EXPECT_LT((j.direction_by_direction.col(k) - numerical.tail<3>()).norm(), 1e-9);
    }
  }
}

OrientedCamera CameraBefore(const Case& c) {
  OrientedCamera camera{{1000, 1000, {}, 300.0}, {}, c.interface};
  camera.camera.interior << 2000, 3, -4, 1e-8, 0, 0, 1e-7, 0, 0, 0;
  const Eigen::Quaterniond look = Eigen::Quaterniond::FromTwoVectors(
      (c.point - c.center).normalized(), Eigen::Vector3d(0.05, -0.03, 1).normalized());
  camera.cam_from_world.rotation = look.toRotationMatrix();
  camera.cam_from_world.translation_mm = -(camera.cam_from_world.rotation * c.center);
  return camera;
}

TEST(Refraction, DerivativesOfAPicture) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const Case c = MakeCase(seed, seed % 2 == 0);
    const OrientedCamera camera = CameraBefore(c);
    OrientedJacobians j;
    ASSERT_TRUE(ProjectFromWorld(camera, c.point, &j));
    for (int k = 0; k < 6; ++k) {
      auto at = [&](double h) {
        OrientedCamera t = camera;
        if (k < 3) {
          t.cam_from_world.rotation =
              RotationFromVector(h * Eigen::Vector3d::Unit(k)) * camera.cam_from_world.rotation;
        } else {
          t.cam_from_world.translation_mm[k - 3] += h;
        }
        return Eigen::VectorXd(*ProjectFromWorld(t, c.point));
      };
      const Eigen::VectorXd numerical = Numerical(at, k < 3 ? 1e-4 : 0.2);
      EXPECT_LT((j.by_camera.col(kNumInterior + k) - numerical).norm(),
                1e-6 * (numerical.norm() + 1))
          << "seed " << seed << " parameter " << k;
    }
    for (int k = 0; k < 3; ++k) {
      auto at = [&](double h) {
        return Eigen::VectorXd(*ProjectFromWorld(camera, c.point + h * Eigen::Vector3d::Unit(k)));
      };
      EXPECT_LT((j.by_point.col(k) - Numerical(at, 0.2)).norm(), 1e-6);
    }
    Eigen::Matrix<double, 3, 2> direction, origin;
    const Eigen::Vector2d pixel = *ProjectFromWorld(camera, c.point);
    ASSERT_TRUE(RayFromPixel(camera, pixel, &direction, &origin));
    for (int k = 0; k < 2; ++k) {
      auto at = [&](double h) {
        const Ray ray = *RayFromPixel(camera, pixel + h * Eigen::Vector2d::Unit(k));
        Eigen::VectorXd both(6);
        both << ray.origin_mm, ray.direction;
        return both;
      };
      const Eigen::VectorXd numerical = Numerical(at, 0.5);
      EXPECT_LT((origin.col(k) - numerical.head<3>()).norm(), 1e-7);
      EXPECT_LT((direction.col(k) - numerical.tail<3>()).norm(), 1e-9);
    }
  }
}

}  // namespace
}  // namespace videogrammetry
