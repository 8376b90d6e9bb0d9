#include "videogrammetry/geometry/circle_normal.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace videogrammetry {
namespace {

constexpr int kMaxIterations = 15;
// A larger step could turn the normal over the limb, to another minimum.
constexpr double kMaxTurnRad = 0.3;
// A normal this sure, in rad, has a linear picture in the shapes.
constexpr double kLinearRad = 0.05;

/// An ellipse's shape in the plane z = 1, whitened, and where its camera is.
struct Shape {
  Eigen::Matrix3d rotation;  // cam_from_world
  Eigen::Vector3d center_in_cam;
  Eigen::Vector3d measured;  // (S_xx, S_xy, S_yy)
  Eigen::Matrix3d whiten;
};

/// Normal and log radius of a circle, the unknowns.
struct State {
  Eigen::Vector3d normal;
  double log_radius = 0.0;
};

struct System {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();  // by two tangents and log radius
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  double chi2 = 0.0;   // of the shapes
  double prior = 0.0;  // of the prior
};

std::optional<Shape> ShapeOf(const Rig& rig, const EllipseSighting& s,
                             const Eigen::Vector3d& position) {
  const Ellipse& e = s.ellipse;
  const double a = e.semi_major_px, b = e.semi_minor_px;
  if (!(b > 0) || !(a >= b) || !std::isfinite(a) || !std::isfinite(e.angle_rad)) {
    return std::nullopt;
  }
  const OrientedCamera& camera = rig[static_cast<std::size_t>(s.camera)];
  if (camera.interface) return std::nullopt;  // refraction would pass for a tilt
  Shape shape;
  shape.rotation = camera.cam_from_world.rotation;
  shape.center_in_cam = camera.cam_from_world * position;
  Eigen::Matrix2d by_pixel;
  if (!(shape.center_in_cam.z() > 0) ||
      !RayThroughPixel(camera.camera, {e.x_px, e.y_px}, &by_pixel)) {
    return std::nullopt;
  }
  const Eigen::Vector2d along(std::cos(e.angle_rad), std::sin(e.angle_rad));
  const Eigen::Vector2d m = by_pixel * along, k = by_pixel * Eigen::Vector2d(-along.y(), along.x());
  auto three = [](const Eigen::Matrix2d& x) { return Eigen::Vector3d(x(0, 0), x(0, 1), x(1, 1)); };
  const Eigen::Matrix2d full = a * a * m * m.transpose() + b * b * k * k.transpose();
  Eigen::Matrix3d by_ellipse;  // of (a, b, angle)
  by_ellipse.col(0) = three(2 * a * m * m.transpose());
  by_ellipse.col(1) = three(2 * b * k * k.transpose());
  by_ellipse.col(2) = three((a * a - b * b) * (m * k.transpose() + k * m.transpose()));
  Eigen::Matrix3d by_axes = by_ellipse;
  // A round ellipse has no angle: what its axes scatter, its third number does too.
  Eigen::Matrix3d cov = s.cov;
  const double round = (cov(0, 0) + cov(1, 1)) / 2;
  if (!((a * a - b * b) * (a * a - b * b) * cov(2, 2) > (a + b) * (a + b) / 4 * round)) {
    cov.row(2).setZero();
    cov.col(2).setZero();
    cov(2, 2) = round;
    by_axes.col(2) = three((a + b) / 2 * (m * k.transpose() + k * m.transpose()));
  }
  const Eigen::Matrix3d cov_shape = by_axes * cov * by_axes.transpose();
  const Eigen::LLT<Eigen::Matrix3d> factor(cov_shape);
  if (!cov_shape.allFinite() || factor.info() != Eigen::Success) return std::nullopt;
  shape.whiten = factor.matrixL().solve(Eigen::Matrix3d::Identity());
  shape.measured = three(full);
  return shape;
}

/// The two normals, towards the camera, that weak perspective allows an ellipse.
std::array<State, 2> CandidatesOf(const Shape& shape) {
  const Eigen::Vector3d ray = shape.center_in_cam.normalized();
  // The picture on the unit sphere: d(direction) = (I - ray ray^T) d(x, y) ray_z.
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(ray);
  const Eigen::Matrix2d across = ray.z() * basis.topRows<2>().transpose();
  Eigen::Matrix2d full;
  full << shape.measured[0], shape.measured[1], shape.measured[1], shape.measured[2];
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(across * full * across.transpose());
  const double ratio = std::sqrt(std::max(0.0, axes.eigenvalues()[0] / axes.eigenvalues()[1]));
  const double radius = std::sqrt(axes.eigenvalues()[1]) * shape.center_in_cam.norm();
  const double cosine = std::min(1.0, ratio);
  const double tilt = std::sqrt(std::max(1 - cosine * cosine, 1e-4));
  const Eigen::Vector3d side = basis * axes.eigenvectors().col(0);
  std::array<State, 2> result;
  for (int k = 0; k < 2; ++k) {
    const Eigen::Vector3d n = (-cosine * ray + (k == 0 ? tilt : -tilt) * side).normalized();
    result[k] = {shape.rotation.transpose() * n, std::log(radius)};
  }
  return result;
}

/// Tangent coordinates of `normal` about `base` (half space of base).
Eigen::Vector3d Turn(const Eigen::Vector3d& normal, const Eigen::Vector3d& step) {
  return (normal + step).normalized();
}

bool Linearise(const std::vector<Shape>& shapes, const Eigen::Vector3d& sight, const State& state,
               System* system) {
  *system = {};
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(state.normal);
  for (const Shape& s : shapes) {
    Eigen::Matrix<double, 3, 4> by;
    const auto predicted = ProjectedShape(
        {s.center_in_cam, s.rotation * state.normal, std::exp(state.log_radius)}, &by);
    if (!predicted) return false;
    const Eigen::Vector3d residual = s.whiten * (s.measured - *predicted);
    Eigen::Matrix3d j;
    j.leftCols<2>() = s.whiten * by.leftCols<3>() * s.rotation * basis;
    j.col(2) = s.whiten * by.col(3);
    system->information += j.transpose() * j;
    system->right += j.transpose() * residual;
    system->chi2 += residual.squaredNorm();
  }
  // Prior: the component of the normal across the mean line of sight.
  const double weight = 1 / (kNormalPriorRad * kNormalPriorRad);
  const Eigen::Vector3d off = state.normal - sight * sight.dot(state.normal);
  const Eigen::Matrix<double, 3, 2> by_step = basis - sight * (sight.transpose() * basis);
  system->information.topLeftCorner<2, 2>() += weight * by_step.transpose() * by_step;
  system->right.head<2>() -= weight * by_step.transpose() * off;
  system->prior = weight * off.squaredNorm();
  return true;
}

/// Levenberg-Marquardt from `state`; the cost at the end, or nothing.
std::optional<System> Minimise(const std::vector<Shape>& shapes, const Eigen::Vector3d& sight,
                               State* state) {
  System system;
  if (!Linearise(shapes, sight, *state, &system)) return std::nullopt;
  double damping = 1e-6;
  for (int i = 0; i < kMaxIterations; ++i) {
    Eigen::Matrix3d damped = system.information;
    damped.diagonal() *= 1 + damping;
    Eigen::Vector3d step = damped.ldlt().solve(system.right);
    const double turn = step.head<2>().norm();
    if (turn > kMaxTurnRad) step *= kMaxTurnRad / turn;
    if (!step.allFinite()) return std::nullopt;
    State next;
    next.normal = Turn(state->normal, TangentBasis(state->normal) * step.head<2>());
    next.log_radius = state->log_radius + step[2];
    System there;
    if (Linearise(shapes, sight, next, &there) &&
        there.chi2 + there.prior <= system.chi2 + system.prior + 1e-12) {
      const double gain = step.dot(system.information * step);
      *state = next;
      system = there;
      damping = std::max(1e-6, damping / 10);
      if (gain < 1e-8) break;  // a step of 1e-4 sigmas
    } else {
      damping = std::max(1e-2, damping * 10);
      if (damping > 1e8) break;
    }
  }
  return system;
}

/// Covariance of the two tangent coordinates. Where they are not small the tilt
/// shows in second order only, the information i(s) grows with the displacement s,
/// and the deviation that explains itself, s^2 = 1 / i(s), is sought: a step goes to
/// the geometric mean of s^2 and 1 / i(s), which is the solution where i ~ s^2.
Eigen::Matrix2d TangentCovariance(const std::vector<Shape>& shapes, const Eigen::Vector3d& sight,
                                  const State& state, const System& at) {
  Eigen::Matrix2d cov = at.information.inverse().topLeftCorner<2, 2>();
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(state.normal);
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(cov);
  if (!(axes.eigenvalues()[1] > kLinearRad * kLinearRad)) return cov;
  constexpr int kRounds = 6;
  for (int round = 0; round < kRounds; ++round) {
    const Eigen::Vector2d sigma = axes.eigenvalues().cwiseMax(0.0).cwiseSqrt();
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    int count = 0;
    for (int corner = 0; corner < 4; ++corner) {
      const Eigen::Vector2d sign(corner % 2 == 0 ? 1 : -1, corner < 2 ? 1 : -1);
      const Eigen::Vector3d step = basis * (axes.eigenvectors() * sigma.cwiseProduct(sign));
      const Eigen::Vector3d normal = Turn(state.normal, step);
      System there;
      if (!Linearise(shapes, sight, {normal, state.log_radius}, &there)) continue;
      // In the tangents of the centre, not of the displaced normal.
      Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
      turn.topLeftCorner<2, 2>() = TangentBasis(normal).transpose() * basis;
      sum += turn.transpose() * there.information * turn;
      ++count;
    }
    if (count == 0) break;
    const Eigen::Matrix2d found = Eigen::Matrix3d(sum / count).inverse().topLeftCorner<2, 2>();
    const Eigen::Matrix2d& v = axes.eigenvectors();
    Eigen::Vector2d variance;
    for (int k = 0; k < 2; ++k) variance[k] = sigma[k] * std::sqrt(v.col(k).dot(found * v.col(k)));
    cov = v * variance.asDiagonal() * v.transpose();
    axes.compute(cov);
  }
  return cov;
}

struct Mode {
  State state;
  System system;
  Eigen::Matrix3d cov;
};

std::optional<Mode> ModeFrom(const std::vector<Shape>& shapes, const Eigen::Vector3d& sight,
                             State start) {
  const auto system = Minimise(shapes, sight, &start);
  if (!system) return std::nullopt;
  // Shapes are even in the normal; the side that faces the cameras is meant.
  if (start.normal.dot(sight) < 0) start.normal = -start.normal;
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(start.normal);
  const Eigen::Matrix2d cov = TangentCovariance(shapes, sight, start, *system);
  if (!cov.allFinite()) return std::nullopt;
  return Mode{start, *system, basis * cov * basis.transpose()};
}

/// Mean and covariance of two modes together.
NormalEstimate Merge(const Mode& first, const Mode& second) {
  const double lead =
      second.system.chi2 + second.system.prior - first.system.chi2 - first.system.prior;
  const double share = 1 / (1 + std::exp(-0.5 * lead));  // of the first
  NormalEstimate result;
  result.normal = (share * first.state.normal + (1 - share) * second.state.normal).normalized();
  const Eigen::Vector3d d1 = first.state.normal - result.normal;
  const Eigen::Vector3d d2 = second.state.normal - result.normal;
  const Eigen::Matrix3d across =
      Eigen::Matrix3d::Identity() - result.normal * result.normal.transpose();
  result.cov = across *
               (share * (first.cov + d1 * d1.transpose()) +
                (1 - share) * (second.cov + d2 * d2.transpose())) *
               across;
  result.radius_mm =
      std::exp(share * first.state.log_radius + (1 - share) * second.state.log_radius);
  result.chi2 = first.system.chi2;
  return result;
}

}  // namespace

Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& normal) {
  // The axis that is most across the normal.
  int axis = 0;
  normal.cwiseAbs().minCoeff(&axis);
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = normal.cross(Eigen::Vector3d::Unit(axis)).normalized();
  basis.col(1) = normal.cross(basis.col(0));
  return basis;
}

std::optional<NormalEstimate> EstimateNormal(const Rig& rig,
                                             std::span<const EllipseSighting> sightings,
                                             const Eigen::Vector3d& position) {
  if (!position.allFinite()) return std::nullopt;
  std::vector<Shape> shapes;
  Eigen::Vector3d sight = Eigen::Vector3d::Zero();  // towards the cameras
  for (const EllipseSighting& s : sightings) {
    const auto shape = ShapeOf(rig, s, position);
    if (!shape) continue;
    shapes.push_back(*shape);
    sight -= shape->rotation.transpose() * shape->center_in_cam.normalized();
  }
  if (shapes.empty() || !(sight.norm() > 1e-3)) return std::nullopt;
  sight.normalize();

  std::array<State, 2> best;
  double least = std::numeric_limits<double>::infinity();
  for (const Shape& shape : shapes) {
    const std::array<State, 2> pair = CandidatesOf(shape);
    for (int k = 0; k < 2; ++k) {
      System system;
      if (!Linearise(shapes, sight, pair[k], &system)) continue;
      if (system.chi2 + system.prior < least) {
        least = system.chi2 + system.prior;
        best = {pair[k], pair[1 - k]};
      }
    }
  }
  if (!std::isfinite(least)) return std::nullopt;
  auto first = ModeFrom(shapes, sight, best[0]);
  auto second = ModeFrom(shapes, sight, best[1]);
  if (!first && !second) return std::nullopt;
  if (!first) std::swap(first, second);
  if (second &&
      second->system.chi2 + second->system.prior < first->system.chi2 + first->system.prior) {
    std::swap(first, second);
  }
  NormalEstimate result;
  constexpr double kSameRad = 1e-3;
  if (second && (first->state.normal - second->state.normal).norm() > kSameRad) {
    result = Merge(*first, *second);
  } else {
    result = {first->state.normal, first->cov, std::exp(first->state.log_radius),
              first->system.chi2};
  }
  const double freedom = 3.0 * static_cast<double>(shapes.size()) - 3.0;
  if (freedom > 0 && result.chi2 > freedom) result.cov *= result.chi2 / freedom;
  return result;
}

}  // namespace videogrammetry
