#include "videogrammetry/adjustment/resection.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>

#include "videogrammetry/adjustment/homography.h"
#include "videogrammetry/adjustment/p3p.h"

namespace videogrammetry {
namespace {

constexpr double kDistinctRad = 0.035;  // 2 degrees
constexpr std::size_t kRefined = 3;     // best poses of the sampling that are refined

double AngleBetween(const Rigid3& a, const Rigid3& b) {
  return VectorFromRotation(a.rotation * b.rotation.transpose()).norm();
}

/// Distance from the prediction, px; infinite behind the camera.
double Distance(const Rigid3& pose, double f_px, const Eigen::Vector3d& point,
                const Eigen::Vector2d& ideal_px) {
  const Eigen::Vector3d p = pose * point;
  if (!(p.z() > 0)) return HUGE_VAL;
  return (f_px * p.head<2>() / p.z() - ideal_px).norm();
}

PoseCandidate Judge(const Rigid3& pose, const Eigen::Ref<const Points3d>& points_mm,
                    const Eigen::Ref<const Points2d>& ideal_px, double f_px, double threshold_px) {
  PoseCandidate candidate{pose, 0.0, 0};
  for (Eigen::Index i = 0; i < points_mm.rows(); ++i) {
    const double e =
        Distance(pose, f_px, points_mm.row(i).transpose(), ideal_px.row(i).transpose());
    candidate.inliers += e < threshold_px;
    candidate.cost_px2 += std::min(e * e, threshold_px * threshold_px);
  }
  candidate.cost_px2 /= static_cast<double>(points_mm.rows());
  return candidate;
}

bool Better(const PoseCandidate& a, const PoseCandidate& b) { return a.cost_px2 < b.cost_px2; }

/// Best first, poses closer than `apart_rad` to a better one removed, at most `count`.
std::vector<PoseCandidate> Distinct(std::vector<PoseCandidate> all, double apart_rad,
                                    std::size_t count) {
  std::stable_sort(all.begin(), all.end(), Better);
  std::vector<PoseCandidate> kept;
  for (const PoseCandidate& c : all) {
    const bool is_new = std::none_of(kept.begin(), kept.end(), [&](const PoseCandidate& k) {
      return AngleBetween(k.cam_from_object, c.cam_from_object) < apart_rad;
    });
    if (is_new) kept.push_back(c);
    if (kept.size() == count) break;
  }
  return kept;
}

struct NormalSystem {
  Eigen::Matrix<double, 6, 6> matrix = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 1> right = Eigen::Matrix<double, 6, 1>::Zero();
  double loss = 0.0;
  int count = 0;
};

NormalSystem BuildSystem(const Eigen::Ref<const Points3d>& points_mm,
                         const Eigen::Ref<const Points2d>& ideal_px, double f_px, double scale_px,
                         const Rigid3& pose) {
  NormalSystem system;
  const double s2 = scale_px * scale_px;
  for (Eigen::Index i = 0; i < points_mm.rows(); ++i) {
    const Eigen::Vector3d turned = pose.rotation * points_mm.row(i).transpose();
    const Eigen::Vector3d p = turned + pose.translation_mm;
    if (!(p.z() > 0) || !ideal_px.row(i).allFinite()) {
      system.loss += s2 * 50;  // worse than any point in front
      continue;
    }
    const double z = 1 / p.z();
    const Eigen::Vector2d e = ideal_px.row(i).transpose() - f_px * z * p.head<2>();
    const double ratio = e.squaredNorm() / s2;
    system.loss += s2 * std::log1p(ratio);
    ++system.count;
    Eigen::Matrix<double, 2, 3> by_point;
    by_point << f_px * z, 0, -f_px * p.x() * z * z, 0, f_px * z, -f_px * p.y() * z * z;
    Eigen::Matrix<double, 2, 6> j;
    j.leftCols<3>() << by_point.col(2) * turned.y() - by_point.col(1) * turned.z(),
        by_point.col(0) * turned.z() - by_point.col(2) * turned.x(),
        by_point.col(1) * turned.x() - by_point.col(0) * turned.y();
    j.rightCols<3>() = by_point;
    const double weight = 1 / (1 + ratio);
    system.matrix += weight * j.transpose() * j;
    system.right += weight * j.transpose() * e;
  }
  return system;
}

/// Three different indices; the widest of a few random triples in the picture,
/// because close points give a pose that is mostly noise.
std::array<Eigen::Index, 3> DrawTriple(const Eigen::Ref<const Points2d>& ideal_px,
                                       std::mt19937* random) {
  const Eigen::Index n = ideal_px.rows();
  std::array<Eigen::Index, 3> best{0, 1, 2};
  double widest = -1.0;
  for (int attempt = 0; attempt < 4; ++attempt) {
    std::array<Eigen::Index, 3> t;
    t[0] = static_cast<Eigen::Index>((*random)() % static_cast<std::uint32_t>(n));
    do {
      t[1] = static_cast<Eigen::Index>((*random)() % static_cast<std::uint32_t>(n));
    } while (t[1] == t[0]);
    do {
      t[2] = static_cast<Eigen::Index>((*random)() % static_cast<std::uint32_t>(n));
    } while (t[2] == t[0] || t[2] == t[1]);
    const Eigen::RowVector2d u = ideal_px.row(t[1]) - ideal_px.row(t[0]);
    const Eigen::RowVector2d v = ideal_px.row(t[2]) - ideal_px.row(t[0]);
    const double area = std::abs(u.x() * v.y() - u.y() * v.x());
    if (area > widest) {
      widest = area;
      best = t;
    }
  }
  return best;
}

std::vector<PoseCandidate> Sample(const Eigen::Ref<const Points3d>& points_mm,
                                  const Eigen::Ref<const Points2d>& ideal_px, double f_px,
                                  const ResectionOptions& options) {
  std::mt19937 random(options.seed);
  std::vector<PoseCandidate> found;
  int most_inliers = 0;
  for (int i = 0; i < options.num_samples; ++i) {
    // Enough when a triple without a wrong number is missing with 1e-6 only;
    // never fewer than a dozen, so that the mirrored pose shows up too.
    const double share = static_cast<double>(most_inliers) / static_cast<double>(points_mm.rows());
    if (i >= 12 && std::pow(1.0 - share * share * share, i) < 1e-6) break;
    const auto triple = DrawTriple(ideal_px, &random);
    Eigen::Matrix3d points, rays;
    Eigen::Matrix<double, 2, 3> pictures;
    for (int k = 0; k < 3; ++k) {
      points.col(k) = points_mm.row(triple[k]).transpose();
      pictures.col(k) = ideal_px.row(triple[k]).transpose();
      rays.col(k) = Eigen::Vector3d(pictures(0, k), pictures(1, k), f_px).normalized();
    }
    for (const Rigid3& pose : SolveP3P(points, rays)) {
      found.push_back(Judge(pose, points_mm, ideal_px, f_px, options.threshold_px));
      most_inliers = std::max(most_inliers, found.back().inliers);
    }
    for (const Rigid3& pose : SolveWeakPerspective(points, pictures, f_px)) {
      found.push_back(Judge(pose, points_mm, ideal_px, f_px, options.threshold_px));
    }
  }
  return Distinct(std::move(found), kDistinctRad, kRefined);
}

/// The plane's normal (direction of least extent), and the points' mean.
void FitPlane(const Eigen::Ref<const Points3d>& points_mm, Eigen::Vector3d* centre,
              Eigen::Vector3d* normal) {
  Eigen::Matrix3d axes;
  PrincipalExtents(points_mm, &axes);
  *normal = axes.col(2);
  *centre = points_mm.colwise().mean().transpose();
}

}  // namespace

Points2d IdealPoints(const Camera& camera, const Eigen::Ref<const Points2d>& pixels) {
  Points2d ideal(pixels.rows(), 2);
  for (Eigen::Index i = 0; i < pixels.rows(); ++i) {
    const auto p = Undistort(camera, pixels.row(i).transpose());
    ideal.row(i) = p.value_or(Eigen::Vector2d::Constant(HUGE_VAL)).transpose();
  }
  return ideal;
}

bool RefinePose(const Eigen::Ref<const Points3d>& points_mm,
                const Eigen::Ref<const Points2d>& ideal_px, double f_px, double scale_px,
                Rigid3* cam_from_object) {
  double damping = 1e-6;
  NormalSystem system = BuildSystem(points_mm, ideal_px, f_px, scale_px, *cam_from_object);
  for (int i = 0; i < 30; ++i) {
    if (system.count < 3) return false;
    Eigen::Matrix<double, 6, 6> matrix = system.matrix;
    matrix.diagonal() *= 1 + damping;
    const Eigen::Matrix<double, 6, 1> step = matrix.ldlt().solve(system.right);
    if (!step.allFinite()) return false;
    Rigid3 trial;
    trial.rotation = RotationFromVector(step.head<3>()) * cam_from_object->rotation;
    trial.translation_mm = cam_from_object->translation_mm + step.tail<3>();
    const NormalSystem after = BuildSystem(points_mm, ideal_px, f_px, scale_px, trial);
    if (!(after.loss < system.loss)) {
      damping *= 10;
      if (damping > 1e6) break;
      continue;
    }
    const bool done = system.loss - after.loss < 1e-6 * system.loss;
    *cam_from_object = trial;
    system = after;
    damping = std::max(1e-9, damping / 10);
    if (done) break;
  }
  cam_from_object->rotation = NearestRotation(cam_from_object->rotation);
  return true;
}

std::vector<PoseCandidate> Resect(const Camera& camera, const Eigen::Ref<const Points3d>& points_mm,
                                  const Eigen::Ref<const Points2d>& pixels,
                                  const ResectionOptions& options) {
  if (points_mm.rows() != pixels.rows()) {
    throw std::invalid_argument("Resect: " + std::to_string(points_mm.rows()) + " points but " +
                                std::to_string(pixels.rows()) + " pixels");
  }
  if (points_mm.rows() < 4) return {};
  const double f = camera.f_px();
  const Points2d ideal = IdealPoints(camera, pixels);
  std::vector<PoseCandidate> starts = Sample(points_mm, ideal, f, options);
  Eigen::Vector3d centre, normal;
  FitPlane(points_mm, &centre, &normal);
  std::vector<PoseCandidate> refined;
  const std::size_t sampled = starts.size();
  for (std::size_t i = 0; i < sampled + std::min<std::size_t>(sampled, 1); ++i) {
    // After the sampled poses, the best one's flipped twin.
    Rigid3 pose =
        i < sampled
            ? starts[i].cam_from_object
            : FlippedPose(std::min_element(refined.begin(), refined.end(), Better)->cam_from_object,
                          centre, normal);
    const bool ok = RefinePose(points_mm, ideal, f, 0.5 * options.threshold_px, &pose) &&
                    RefinePose(points_mm, ideal, f, 0.1 * options.threshold_px, &pose);
    if (ok || i == 0) {
      refined.push_back(Judge(pose, points_mm, ideal, f, options.threshold_px));
    }
  }
  std::vector<PoseCandidate> best = Distinct(std::move(refined), kDistinctRad, 2);
  std::erase_if(best, [](const PoseCandidate& c) { return c.inliers < 4; });
  return best;
}

}  // namespace videogrammetry
