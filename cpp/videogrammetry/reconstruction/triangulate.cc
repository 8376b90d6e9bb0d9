#include "videogrammetry/reconstruction/triangulate.h"

#include <Eigen/LU>
#include <limits>
#include <stdexcept>
#include <string>

#include "videogrammetry/core/thread_pool.h"

namespace videogrammetry {
namespace {

using RowMatrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

void CheckArguments(const Rig& rig, const MatchArrays& matches,
                    const Eigen::Ref<const Eigen::MatrixXd>& cov_rig) {
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
  const auto expected = static_cast<Eigen::Index>(rig.size()) * kNumCameraParameters;
  if (cov_rig.rows() != 0 && (cov_rig.rows() != expected || cov_rig.cols() != expected)) {
    throw std::invalid_argument("cov_rig: expected " + std::to_string(expected) + " rows, got " +
                                std::to_string(cov_rig.rows()));
  }
}

// G C G^T with the derivatives of this point's sightings; see the header.
Eigen::Matrix3d CalibrationPart(const Rig& rig, const std::vector<Sighting>& sightings,
                                const Intersection& point,
                                const Eigen::Ref<const Eigen::MatrixXd>& cov_rig) {
  const auto n = static_cast<Eigen::Index>(sightings.size());
  Eigen::Matrix<double, 3, Eigen::Dynamic> gain(3, n * kNumCameraParameters);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Sighting& s = sightings[static_cast<std::size_t>(i)];
    OrientedJacobians jacobians;
    if (!ProjectFromWorld(rig[static_cast<std::size_t>(s.camera)], point.position_mm,
                          &jacobians)) {
      return Eigen::Matrix3d::Constant(kNan);
    }
    gain.middleCols<kNumCameraParameters>(i * kNumCameraParameters) =
        -point.cov_mm2 * jacobians.by_point.transpose() * s.cov_px2.inverse() *
        jacobians.by_camera;
  }
  Eigen::Matrix3d part = Eigen::Matrix3d::Zero();
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) {
      const auto block = cov_rig.block<kNumCameraParameters, kNumCameraParameters>(
          sightings[static_cast<std::size_t>(i)].camera * kNumCameraParameters,
          sightings[static_cast<std::size_t>(j)].camera * kNumCameraParameters);
      part += gain.middleCols<kNumCameraParameters>(i * kNumCameraParameters) * block *
              gain.middleCols<kNumCameraParameters>(j * kNumCameraParameters).transpose();
    }
  }
  return part;
}

}  // namespace

TriangulatedPoints Triangulate(const Rig& rig, const MatchArrays& matches,
                               const Eigen::Ref<const Eigen::MatrixXd>& cov_rig,
                               const TriangulationOptions& options) {
  CheckArguments(rig, matches, cov_rig);
  const std::size_t count = matches.offsets.size() - 1;
  TriangulatedPoints points;
  points.position_mm.assign(3 * count, kNan);
  points.cov_image.assign(9 * count, kNan);
  points.cov_rig.assign(9 * count, cov_rig.rows() == 0 ? 0.0 : kNan);
  points.chi2.assign(count, kNan);
  points.convergence_rad.assign(count, kNan);
  points.residual_px.assign(2 * matches.camera.size(), kNan);
  points.status.assign(count, 0);

  auto one = [&](int index) {
    const auto i = static_cast<std::size_t>(index);
    const auto begin = static_cast<std::size_t>(matches.offsets[i]);
    const auto end = static_cast<std::size_t>(matches.offsets[i + 1]);
    std::vector<Sighting> sightings;
    sightings.reserve(end - begin);
    for (std::size_t m = begin; m < end; ++m) {
      Sighting s;
      s.camera = matches.camera[m];
      s.pixel = {matches.xy_px[2 * m], matches.xy_px[2 * m + 1]};
      s.cov_px2 << matches.cov_px2[3 * m], matches.cov_px2[3 * m + 1], matches.cov_px2[3 * m + 1],
          matches.cov_px2[3 * m + 2];
      sightings.push_back(s);
    }
    Intersection point;
    const IntersectionStatus status = Intersect(rig, sightings, &point);
    points.status[i] = static_cast<std::uint8_t>(status);
    if (status != IntersectionStatus::kOk) return;
    Eigen::Map<Eigen::Vector3d>(&points.position_mm[3 * i]) = point.position_mm;
    Eigen::Map<RowMatrix3>(&points.cov_image[9 * i]) = point.cov_mm2;
    points.chi2[i] = point.chi2;
    points.convergence_rad[i] = point.convergence_rad;
    for (std::size_t k = 0; k < sightings.size(); ++k) {
      points.residual_px[2 * (begin + k)] = point.residuals_px[k].x();
      points.residual_px[2 * (begin + k) + 1] = point.residuals_px[k].y();
    }
    if (cov_rig.rows() != 0) {
      Eigen::Map<RowMatrix3>(&points.cov_rig[9 * i]) =
          CalibrationPart(rig, sightings, point, cov_rig);
    }
  };
  ParallelFor(static_cast<int>(count), options.num_threads, one);
  return points;
}

}  // namespace videogrammetry
