#include "videogrammetry/reconstruction/circle_intersection.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace videogrammetry {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr int kMaxIterations = 10;

using Vector5 = Eigen::Matrix<double, 5, 1>;
using Matrix5 = Eigen::Matrix<double, 5, 5>;

/// Normal equations of the point and of two tangents of the normal.
struct System {
  Matrix5 normal = Matrix5::Zero();
  Vector5 right = Vector5::Zero();
};

struct Row {
  Eigen::Vector2d residual_px;
  Eigen::Matrix<double, 2, 5> by;
};

bool Linearise(const Rig& rig, std::span<const Sighting> sightings, const Circle& circle,
               const Eigen::Matrix<double, 3, 2>& basis, std::vector<Row>* rows, System* system) {
  *system = {};
  for (std::size_t k = 0; k < sightings.size(); ++k) {
    const OrientedCamera& camera = rig[static_cast<std::size_t>(sightings[k].camera)];
    const Eigen::Matrix3d& rotation = camera.cam_from_world.rotation;
    EllipseCenterJacobians j;
    const auto pixel = ProjectEllipseCenter(
        camera.camera,
        {camera.cam_from_world * circle.center_mm, rotation * circle.normal, circle.radius_mm}, &j);
    if (!pixel) return false;
    Row& row = (*rows)[k];
    row.residual_px = sightings[k].pixel - *pixel;
    row.by.leftCols<3>() = j.by_center * rotation;
    row.by.rightCols<2>() = j.by_normal * rotation * basis;
    const Eigen::Matrix<double, 5, 2> weighted =
        row.by.transpose() * sightings[k].cov_px2.inverse();
    system->normal += weighted * row.by;
    system->right += weighted * row.residual_px;
  }
  return true;
}

bool FindNormal(const Rig& rig, std::span<const Sighting> sightings, const MeasuredCircle& circle,
                const Eigen::Vector3d& position, CircleIntersection* result) {
  if (circle.normal.allFinite()) {
    result->status = CircleStatus::kKnown;
    result->normal = circle.normal;
    result->cov_normal = circle.cov_normal;
    Eigen::Vector3d sight = Eigen::Vector3d::Zero();
    for (const Sighting& s : sightings) {
      sight += (rig[static_cast<std::size_t>(s.camera)].center_in_world() - position).normalized();
    }
    if (result->normal.dot(sight) < 0) result->normal = -result->normal;
    return true;
  }
  const auto estimate = EstimateNormal(rig, circle.ellipses, position);
  result->status = estimate ? CircleStatus::kEstimated : CircleStatus::kNoNormal;
  if (!estimate) return false;
  result->normal = estimate->normal;
  result->cov_normal = estimate->cov;
  return true;
}

/// The point by Gauss-Newton with the normal observed; see Triangulate. Sets
/// the covariance Q of point and tangents.
IntersectionStatus Correct(const Rig& rig, std::span<const Sighting> sightings,
                           const MeasuredCircle& measured, const Eigen::Matrix<double, 3, 2>& basis,
                           const Eigen::Matrix2d& cov_tangent, Intersection* point,
                           CircleIntersection* result, Matrix5* q) {
  Circle circle{point->position_mm, result->normal, 0.5 * measured.diameter_mm};
  std::vector<Row> rows(sightings.size());
  System system;
  // With d the tangents' error in units of their covariance's root L there is
  // no weight to become infinite where the normal is exact.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(cov_tangent);
  const Eigen::Matrix2d root =
      axes.eigenvectors() * axes.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
  for (int i = 0; i < kMaxIterations; ++i) {
    if (!Linearise(rig, sightings, circle, basis * root, &rows, &system)) {
      return IntersectionStatus::kBehindCamera;
    }
    Matrix5 joint = system.normal;
    joint.bottomRightCorner<2, 2>() += Eigen::Matrix2d::Identity();
    const Eigen::LDLT<Matrix5> factor(joint);
    const Vector5 step = factor.solve(system.right);
    if (!step.allFinite()) return IntersectionStatus::kNotConverged;
    circle.center_mm += step.head<3>();
    const Eigen::Vector3d move = step.head<3>();
    if (move.dot(system.normal.topLeftCorner<3, 3>() * move) < 1e-6 * 1e-6) {
      point->position_mm = circle.center_mm;
      point->cov_mm2 = system.normal.topLeftCorner<3, 3>().inverse();
      point->chi2 = step.tail<2>().squaredNorm();
      for (std::size_t k = 0; k < rows.size(); ++k) {
        const Eigen::Vector2d residual = rows[k].residual_px - rows[k].by * step;
        point->residuals_px[k] = residual;
        point->chi2 += residual.dot(sightings[k].cov_px2.inverse() * residual);
      }
      *q = factor.solve(Matrix5::Identity());
      q->topRightCorner<3, 2>() = (q->topRightCorner<3, 2>() * root.transpose()).eval();
      q->bottomLeftCorner<2, 3>() = q->topRightCorner<3, 2>().transpose();
      return q->allFinite() ? IntersectionStatus::kOk : IntersectionStatus::kNotConverged;
    }
  }
  return IntersectionStatus::kNotConverged;
}

}  // namespace

CircleIntersection::CircleIntersection()
    : normal(Eigen::Vector3d::Constant(kNan)),
      cov_normal(Eigen::Matrix3d::Constant(kNan)),
      cov_mm2(Eigen::Matrix3d::Constant(kNan)) {}

void CheckCircles(const CircleArrays& circles, std::size_t num_points) {
  if (!std::isfinite(circles.thickness_mm)) {
    throw std::invalid_argument("thickness_mm: expected a finite number, got " +
                                std::to_string(circles.thickness_mm));
  }
  for (std::size_t i = 0; i < num_points; ++i) {
    const std::string name = "circle " + std::to_string(i);
    if (circles.diameter_mm != nullptr && !(std::isnan(circles.diameter_mm[i]))) {
      Circle{{}, Eigen::Vector3d::UnitZ(), 0.5 * circles.diameter_mm[i]}.Check(name.c_str());
    }
    if (circles.normal != nullptr) {
      const Eigen::Map<const Eigen::Vector3d> normal(circles.normal + 3 * i);
      if (!normal.array().isNaN().any()) {
        Circle{Eigen::Vector3d::Zero(), normal, 1.0}.Check(name.c_str());
      }
    }
  }
}

MeasuredCircle CircleOf(const CircleArrays& circles, std::size_t i, std::size_t begin,
                        std::span<const Sighting> sightings) {
  MeasuredCircle circle;
  circle.diameter_mm = circles.diameter_mm != nullptr ? circles.diameter_mm[i] : kNan;
  circle.thickness_mm = circles.thickness_mm;
  circle.normal.setConstant(kNan);
  if (circles.normal != nullptr) {
    circle.normal = Eigen::Map<const Eigen::Vector3d>(circles.normal + 3 * i);
  }
  if (circles.normal_cov != nullptr) {
    circle.cov_normal = Eigen::Map<const Eigen::Matrix3d>(circles.normal_cov + 9 * i);
  }
  if (circles.ellipse == nullptr || circles.ellipse_cov == nullptr) return circle;
  for (std::size_t k = 0; k < sightings.size(); ++k) {
    const double* e = circles.ellipse + 3 * (begin + k);
    circle.ellipses.push_back(
        {sightings[k].camera,
         {sightings[k].pixel.x(), sightings[k].pixel.y(), e[0], e[1], e[2]},
         Eigen::Map<const Eigen::Matrix3d>(circles.ellipse_cov + 9 * (begin + k))});
  }
  return circle;
}

IntersectionStatus IntersectCircle(const Rig& rig, std::span<const Sighting> sightings,
                                   const MeasuredCircle& circle, Intersection* point,
                                   CircleIntersection* result) {
  result->cov_mm2 = point->cov_mm2;
  // How a window distorts an ellipse is not modelled: its centre stays as it is.
  const bool refracted = std::any_of(sightings.begin(), sightings.end(), [&](const Sighting& s) {
    return rig[static_cast<std::size_t>(s.camera)].interface.has_value();
  });
  const bool wanted = !std::isnan(circle.diameter_mm), correct = wanted && !refracted;
  if (wanted && refracted) result->status = CircleStatus::kNoNormal;
  if (!correct && circle.thickness_mm == 0) return IntersectionStatus::kOk;
  if (!FindNormal(rig, sightings, circle, point->position_mm, result)) {
    return circle.thickness_mm == 0 ? IntersectionStatus::kOk : IntersectionStatus::kNoNormal;
  }
  const Eigen::Matrix<double, 3, 2> basis = TangentBasis(result->normal);
  const Eigen::Matrix2d cov_tangent = basis.transpose() * result->cov_normal * basis;
  Matrix5 q = Matrix5::Zero();
  q.topLeftCorner<3, 3>() = point->cov_mm2;
  if (correct) {
    const IntersectionStatus status =
        Correct(rig, sightings, circle, basis, cov_tangent, point, result, &q);
    if (status != IntersectionStatus::kOk) return status;
    for (const Sighting& s : sightings) {
      const OrientedCamera& camera = rig[static_cast<std::size_t>(s.camera)];
      const Eigen::Vector3d in_cam = camera.cam_from_world * point->position_mm;
      const auto center = Project(camera.camera, in_cam);
      const auto ellipse = ProjectEllipseCenter(
          camera.camera,
          {in_cam, camera.cam_from_world.rotation * result->normal, 0.5 * circle.diameter_mm});
      result->offsets_px.push_back(center && ellipse ? Eigen::Vector2d(*ellipse - *center)
                                                     : Eigen::Vector2d::Constant(kNan));
    }
  }
  const double t = circle.thickness_mm;
  result->moved_mm = -t * result->normal;
  const Eigen::Matrix3d cross = t * q.topRightCorner<3, 2>() * basis.transpose();
  result->cov_mm2 = q.topLeftCorner<3, 3>() - cross - cross.transpose() +
                    t * t * basis * cov_tangent * basis.transpose();
  return IntersectionStatus::kOk;
}

}  // namespace videogrammetry
