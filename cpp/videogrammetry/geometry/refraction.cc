#include "videogrammetry/geometry/refraction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

namespace videogrammetry {
namespace {

/// A layer behind the surface: thickness and index.
struct Layer {
  double thickness_mm = 0.0;
  double index = 1.0;
};

/// Glass and fluid down to a point `depth_mm` behind the surface.
std::array<Layer, 2> LayersTo(const FlatInterface& interface, double depth_mm) {
  const double glass_mm = std::min(interface.glass_thickness_mm, depth_mm);
  return {Layer{glass_mm, interface.glass_index},
          Layer{depth_mm - glass_mm, interface.fluid_index}};
}

/// Derivatives of the equation in k (see the header).
struct Equation {
  double by_k = 0.0;
  double by_square = 0.0;  ///< by v.v
  double by_depth = 0.0;   ///< by the thickness of the layer in which the point lies
};

Equation Evaluate(const std::array<Layer, 2>& layers, double height_mm, double k, double square) {
  Equation e{height_mm, 0.0, 0.0};
  for (const Layer& layer : layers) {
    const double n2 = layer.index * layer.index;
    const double under = n2 + (n2 - 1.0) * k * k * square;
    const double root = std::sqrt(under), cube = under * root;
    e.by_k += layer.thickness_mm * n2 / cube;
    e.by_square -= 0.5 * layer.thickness_mm * (n2 - 1.0) * k * k * k / cube;
    // A point inside the glass leaves the fluid with no thickness.
    if (layer.thickness_mm > 0) e.by_depth = k / root;
  }
  return e;
}

double SolveForK(const std::array<Layer, 2>& layers, double height_mm, double square) {
  // In u = 1 / k: a + sum h_i u / sqrt(n_i^2 u^2 + (n_i^2 - 1) q) - u, which is concave, falls
  // at its root and is next to straight: from a + sum h_i / n_i on the falling side three steps.
  double u = height_mm;
  for (const Layer& layer : layers) u += layer.thickness_mm / layer.index;
  for (int i = 0; i < 50; ++i) {
    double value = height_mm - u, slope = -1.0;
    for (const Layer& layer : layers) {
      const double n2 = layer.index * layer.index, bent = (n2 - 1.0) * square;
      const double under = n2 * u * u + bent, inverse = 1.0 / std::sqrt(under);
      value += layer.thickness_mm * u * inverse;
      slope += layer.thickness_mm * bent * inverse / under;
    }
    const double step = -value / slope;
    u += step;
    // Quadratic: after a step of 1e-8 the next one is rounding.
    if (std::abs(step) < 1e-8 * u) break;
  }
  return 1.0 / u;
}

}  // namespace

void FlatInterface::Check(const char* what) const {
  auto require = [&](bool condition, const std::string& message) {
    if (!condition) throw std::invalid_argument(std::string(what) + ": " + message);
  };
  require(normal.allFinite() && std::abs(normal.norm() - 1.0) < 1e-6,
          "the normal must be of unit length");
  require(std::isfinite(distance_mm), "distance_mm must be finite");
  require(fluid_index >= 1 && fluid_index <= 4 && glass_index >= 1 && glass_index <= 4,
          "refractive indices must be 1 to 4");
  require(glass_thickness_mm >= 0 && std::isfinite(glass_thickness_mm),
          "the glass' thickness must not be negative");
}

std::optional<Eigen::Vector3d> SeenThrough(const FlatInterface& interface,
                                           const Eigen::Vector3d& point_mm,
                                           const Eigen::Vector3d& center_mm,
                                           RefractionJacobians* jacobians) {
  const Eigen::Vector3d& n = interface.normal;
  const double a = n.dot(center_mm) - interface.distance_mm;
  if (!(a > 0)) return std::nullopt;
  const double depth_mm = interface.distance_mm - n.dot(point_mm);
  if (!(depth_mm > 0)) {
    if (jacobians != nullptr) {
      jacobians->by_point.setIdentity();
      jacobians->by_center.setZero();
      jacobians->by_normal.setZero();
      jacobians->by_distance.setZero();
    }
    return point_mm;
  }
  const Eigen::Vector3d way = point_mm - center_mm;
  const Eigen::Vector3d v = way - way.dot(n) * n;
  const std::array<Layer, 2> layers = LayersTo(interface, depth_mm);
  const double k = SolveForK(layers, a, v.squaredNorm());
  if (jacobians != nullptr) {
    const Equation e = Evaluate(layers, a, k, v.squaredNorm());
    // S = C - a n + m v with m = a k:
    //   dS = dC - n da - a dn + v dm + m dv,  dm = k da + a dk,
    //   dk = -(k da + G_b db + G_q dq) / G_k,  dq = 2 v.dv.
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - n * n.transpose();
    const double m = a * k;
    const double m_by_a = k - a * k / e.by_k, m_by_b = -a * e.by_depth / e.by_k;
    const Eigen::RowVector3d m_by_v = (-2.0 * a * e.by_square / e.by_k) * v.transpose();
    const Eigen::Vector3d by_a = m_by_a * v - n, by_b = m_by_b * v;
    // Of v by the way: `across`; by the normal: -(way.n) I - n way'.
    const Eigen::Matrix3d by_v = v * m_by_v + m * Eigen::Matrix3d::Identity();
    const Eigen::Matrix3d v_by_normal =
        -way.dot(n) * Eigen::Matrix3d::Identity() - n * way.transpose();
    jacobians->by_point = by_v * across - by_b * n.transpose();
    jacobians->by_center = Eigen::Matrix3d::Identity() - by_v * across + by_a * n.transpose();
    jacobians->by_normal = by_v * v_by_normal + by_a * center_mm.transpose() -
                           by_b * point_mm.transpose() - a * Eigen::Matrix3d::Identity();
    jacobians->by_distance = by_b - by_a;
  }
  return center_mm - a * n + a * k * v;
}

std::optional<Ray> RefractRay(const FlatInterface& interface, const Eigen::Vector3d& center_mm,
                              const Eigen::Vector3d& direction, RayJacobians* jacobians) {
  const Eigen::Vector3d& n = interface.normal;
  const double length = direction.norm();
  const Eigen::Vector3d d = direction / length;
  const double a = n.dot(center_mm) - interface.distance_mm, cosine = -d.dot(n);
  if (!(a > 0) || !(cosine > 0)) return std::nullopt;
  const Eigen::Vector3d along = d + cosine * n;  // of length sin(theta)
  const double ng = interface.glass_index, nf = interface.fluid_index;
  const double g = interface.glass_thickness_mm;
  const double glass = std::sqrt(ng * ng - 1.0 + cosine * cosine);
  const double fluid = std::sqrt(nf * nf - 1.0 + cosine * cosine);
  // Per length along the surface: a / cosine in air, g / glass in the glass.
  const double reach_mm = a / cosine + g / glass;
  if (jacobians != nullptr) {
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - n * n.transpose();
    const Eigen::Matrix3d by_length = (Eigen::Matrix3d::Identity() - d * d.transpose()) / length;
    const double reach_by_cosine = -a / (cosine * cosine) - g * cosine / (glass * glass * glass);
    jacobians->origin_by_direction =
        (reach_mm * across - reach_by_cosine * along * n.transpose()) * by_length;
    jacobians->direction_by_direction =
        (across + (cosine / fluid) * n * n.transpose()) / nf * by_length;
  }
  return Ray{center_mm - (a + g) * n + reach_mm * along, (along - fluid * n) / nf};
}

}  // namespace videogrammetry
