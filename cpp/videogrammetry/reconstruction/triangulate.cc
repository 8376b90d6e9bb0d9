#include "videogrammetry/reconstruction/triangulate.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <limits>
#include <stdexcept>
#include <string>

#include "videogrammetry/core/thread_pool.h"
#include "videogrammetry/reconstruction/calibration_part.h"
#include "videogrammetry/reconstruction/circle_intersection.h"

namespace videogrammetry {
namespace {

using RowMatrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

void CheckArguments(const Rig& rig, const MatchArrays& matches) {
  if (matches.offsets.empty() || matches.offsets.front() != 0 ||
      matches.offsets.back() != static_cast<std::int64_t>(matches.camera.size())) {
    throw std::invalid_argument(
        "offsets: expected P + 1 ascending values from 0 to the number of sightings (" +
        std::to_string(matches.camera.size()) + ")");
  }
  for (std::size_t i = 1; i < matches.offsets.size(); ++i) {
    if (matches.offsets[i] < matches.offsets[i - 1]) {
      throw std::invalid_argument("offsets: must ascend, falls at entry " + std::to_string(i));
    }
  }
  for (const std::int32_t camera : matches.camera) {
    if (camera < 0 || camera >= static_cast<std::int32_t>(rig.size())) {
      throw std::invalid_argument("camera: index " + std::to_string(camera) +
                                  " is outside the rig's " + std::to_string(rig.size()) +
                                  " cameras");
    }
  }
}

void CheckCovariance(const Rig& rig, const RigCovariance& covariance) {
  const auto expected = static_cast<Eigen::Index>(rig.size()) * kNumCameraParameters;
  const Eigen::MatrixXd& c = covariance.parameters;
  if (c.rows() != 0 && (c.rows() != expected || c.cols() != expected)) {
    throw std::invalid_argument("rig covariance: expected " + std::to_string(expected) +
                                " rows, got " + std::to_string(c.rows()));
  }
  const Eigen::MatrixXd& m = covariance.frame_by_parameters;
  if (m.rows() != 0 && (m.rows() != 6 || m.cols() != expected)) {
    throw std::invalid_argument("frame_by_parameters: expected (6, " + std::to_string(expected) +
                                "), got (" + std::to_string(m.rows()) + ", " +
                                std::to_string(m.cols()) + ")");
  }
}

/// The sightings of a point, valid until those of the next one are asked for in the thread.
std::span<const Sighting> SightingsOf(const MatchArrays& matches, std::size_t point) {
  thread_local std::vector<Sighting> sightings;
  sightings.clear();
  for (auto m = static_cast<std::size_t>(matches.offsets[point]);
       m < static_cast<std::size_t>(matches.offsets[point + 1]); ++m) {
    Sighting s;
    s.camera = matches.camera[m];
    if (matches.xy_px != nullptr) s.pixel = {matches.xy_px[2 * m], matches.xy_px[2 * m + 1]};
    s.cov_px2 << matches.cov_px2[3 * m], matches.cov_px2[3 * m + 1], matches.cov_px2[3 * m + 1],
        matches.cov_px2[3 * m + 2];
    sightings.push_back(s);
  }
  return sightings;
}

// (J^T W J)^-1 of a given point; false if its rays do not determine it.
bool NoiseCovariance(const Rig& rig, std::span<const Sighting> sightings, Intersection* point) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  for (const Sighting& s : sightings) {
    OrientedJacobians jacobians;
    if (!ProjectFromWorld(rig[static_cast<std::size_t>(s.camera)], point->position_mm,
                          &jacobians)) {
      return false;
    }
    normal += jacobians.by_point.transpose() * s.cov_px2.inverse() * jacobians.by_point;
  }
  const Eigen::LLT<Eigen::Matrix3d> factor(normal);
  // 1e-14: the square of the smallest angle between rays, in rad, that still says a depth.
  if (factor.info() != Eigen::Success || factor.rcond() < 1e-14) return false;
  point->cov_mm2 = factor.solve(Eigen::Matrix3d::Identity());
  return true;
}

}  // namespace

Eigen::MatrixXd SharedFrameMotion(const Rig& rig, const MatchArrays& matches) {
  CheckArguments(rig, matches);
  Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::MatrixXd right =
      Eigen::MatrixXd::Zero(6, static_cast<Eigen::Index>(rig.size()) * kNumCameraParameters);
  int used = 0;
  for (std::size_t i = 0; i + 1 < matches.offsets.size(); ++i) {
    const std::span<const Sighting> sightings = SightingsOf(matches, i);
    Intersection point;
    Eigen::Matrix<double, 3, Eigen::Dynamic> gain;
    if (Intersect(rig, sightings, &point) != IntersectionStatus::kOk ||
        !Gain(rig, sightings, point, &gain)) {
      continue;
    }
    const Eigen::Matrix<double, 3, 6> effect = FrameEffect(point.position_mm);
    normal += effect.transpose() * effect;
    for (std::size_t k = 0; k < sightings.size(); ++k) {
      right.middleCols<kNumCameraParameters>(sightings[k].camera * kNumCameraParameters) +=
          effect.transpose() * gain.middleCols<kNumCameraParameters>(static_cast<Eigen::Index>(k) *
                                                                     kNumCameraParameters);
    }
    ++used;
  }
  if (used < 3) {
    throw std::invalid_argument("frame of the covariance: needs at least 3 points, got " +
                                std::to_string(used));
  }
  return normal.ldlt().solve(right);
}

std::vector<double> PointDerivatives(const Rig& rig, const MatchArrays& matches,
                                     std::span<const double> position_mm,
                                     const Eigen::MatrixXd& frame_by_parameters,
                                     const TriangulationOptions& options) {
  CheckArguments(rig, matches);
  CheckCovariance(rig, {{}, frame_by_parameters});
  const std::size_t count = matches.offsets.size() - 1;
  if (position_mm.size() != 3 * count) {
    throw std::invalid_argument("position_mm: expected (" + std::to_string(count) + ", 3)");
  }
  using RowMatrix = Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor>;
  const auto columns = static_cast<Eigen::Index>(rig.size()) * kNumCameraParameters;
  const std::size_t block = 3 * static_cast<std::size_t>(columns);
  std::vector<double> derivatives(block * count, kNan);
  auto one = [&](int index) {
    const auto i = static_cast<std::size_t>(index);
    const std::span<const Sighting> sightings = SightingsOf(matches, i);
    Intersection point;
    point.position_mm = Eigen::Map<const Eigen::Vector3d>(&position_mm[3 * i]);
    Eigen::Matrix<double, 3, Eigen::Dynamic> gain;
    if (sightings.size() < 2 || !point.position_mm.allFinite() ||
        !NoiseCovariance(rig, sightings, &point) || !Gain(rig, sightings, point, &gain)) {
      return;
    }
    Eigen::Map<RowMatrix> result(&derivatives[block * i], 3, columns);
    result.setZero();
    for (std::size_t k = 0; k < sightings.size(); ++k) {
      result.middleCols<kNumCameraParameters>(sightings[k].camera * kNumCameraParameters) +=
          gain.middleCols<kNumCameraParameters>(static_cast<Eigen::Index>(k) *
                                                kNumCameraParameters);
    }
    if (frame_by_parameters.rows() != 0) {
      result -= FrameEffect(point.position_mm) * frame_by_parameters;
    }
  };
  ParallelFor(static_cast<int>(count), options.num_threads, one);
  return derivatives;
}

TriangulatedPoints Triangulate(const Rig& rig, const MatchArrays& matches,
                               const RigCovariance& rig_covariance,
                               const TriangulationOptions& options, const CircleArrays& circles) {
  CheckArguments(rig, matches);
  CheckCovariance(rig, rig_covariance);
  CheckCircles(circles, matches.offsets.size() - 1);
  const CalibrationPart calibration(rig, rig_covariance);
  const std::size_t count = matches.offsets.size() - 1;
  TriangulatedPoints points;
  points.position_mm.assign(3 * count, kNan);
  points.cov_image.assign(9 * count, kNan);
  points.cov_rig.assign(9 * count, calibration.empty() ? 0.0 : kNan);
  points.chi2.assign(count, kNan);
  points.convergence_rad.assign(count, kNan);
  points.residual_px.assign(2 * matches.camera.size(), kNan);
  points.status.assign(count, 0);
  if (!circles.empty()) {
    points.normal.assign(3 * count, kNan);
    points.cov_normal.assign(9 * count, kNan);
    points.offset_px.assign(2 * matches.camera.size(), 0.0);
    points.circle.assign(count, 0);
  }

  auto one = [&](int index) {
    const auto i = static_cast<std::size_t>(index);
    const auto begin = static_cast<std::size_t>(matches.offsets[i]);
    const std::span<const Sighting> sightings = SightingsOf(matches, i);
    Intersection point;
    IntersectionStatus status = Intersect(rig, sightings, &point);
    CircleIntersection circle;
    if (status == IntersectionStatus::kOk && !circles.empty()) {
      status =
          IntersectCircle(rig, sightings, CircleOf(circles, i, begin, sightings), &point, &circle);
    }
    points.status[i] = static_cast<std::uint8_t>(status);
    if (!circles.empty()) {
      points.circle[i] = static_cast<std::uint8_t>(circle.status);
      Eigen::Map<Eigen::Vector3d>(&points.normal[3 * i]) = circle.normal;
      Eigen::Map<RowMatrix3>(&points.cov_normal[9 * i]) = circle.cov_normal;
      for (std::size_t k = 0; k < circle.offsets_px.size(); ++k) {
        Eigen::Map<Eigen::Vector2d>(&points.offset_px[2 * (begin + k)]) = circle.offsets_px[k];
      }
    }
    if (status != IntersectionStatus::kOk) return;
    const Eigen::Vector3d moved = point.position_mm + circle.moved_mm;
    Eigen::Map<Eigen::Vector3d>(&points.position_mm[3 * i]) = moved;
    Eigen::Map<RowMatrix3>(&points.cov_image[9 * i]) =
        circles.empty() ? point.cov_mm2 : circle.cov_mm2;
    points.chi2[i] = point.chi2;
    points.convergence_rad[i] = point.convergence_rad;
    for (std::size_t k = 0; k < sightings.size(); ++k) {
      points.residual_px[2 * (begin + k)] = point.residuals_px[k].x();
      points.residual_px[2 * (begin + k) + 1] = point.residuals_px[k].y();
    }
    if (!calibration.empty()) {
      Eigen::Map<RowMatrix3>(&points.cov_rig[9 * i]) = calibration.Of(sightings, point);
    }
  };
  ParallelFor(static_cast<int>(count), options.num_threads, one);
  return points;
}

}  // namespace videogrammetry
