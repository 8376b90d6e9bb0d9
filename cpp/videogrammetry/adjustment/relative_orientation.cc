#include "videogrammetry/adjustment/relative_orientation.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>

#include "videogrammetry/adjustment/five_point.h"
#include "videogrammetry/adjustment/homography.h"
#include "videogrammetry/core/median.h"

namespace videogrammetry {
namespace {

constexpr int kMinPairs = 6;            // five always fit
constexpr double kDistinctRad = 0.005;  // of rotation; of the baseline's direction 3 times
constexpr std::size_t kRefined = 10;    // best motions of the sampling that are refined
constexpr double kMissed = 1e-6;        // chance that no sample was free of wrong numbers
constexpr double kGateSigmas = 4.0;
constexpr int kTighter = 2;           // samplings with gates of the noise
constexpr double kMinNoisePx = 1e-4;  // exact pictures have rounding only
constexpr double kMedianChi2One = 0.455, kMedianChi2Two = 1.386;

/// The pairs of rays (X/Z, Y/Z, 1) that both cameras' models allow.
struct Rays {
  Eigen::MatrixX3d a, b;
  std::vector<Eigen::Index> row;  ///< of the caller's arrays
  double f_a = 1.0, f_b = 1.0;
};

Rays UsableRays(const Camera& camera_a, const Eigen::Ref<const Points2d>& pixels_a,
                const Camera& camera_b, const Eigen::Ref<const Points2d>& pixels_b) {
  Rays rays{Eigen::MatrixX3d(pixels_a.rows(), 3),
            Eigen::MatrixX3d(pixels_a.rows(), 3),
            {},
            camera_a.f_px(),
            camera_b.f_px()};
  Eigen::Index count = 0;
  for (Eigen::Index i = 0; i < pixels_a.rows(); ++i) {
    const auto a = RayThroughPixel(camera_a, pixels_a.row(i).transpose());
    const auto b = RayThroughPixel(camera_b, pixels_b.row(i).transpose());
    if (!a || !b || !a->allFinite() || !b->allFinite()) continue;
    rays.a.row(count) = a->transpose();
    rays.b.row(count++) = b->transpose();
    rays.row.push_back(i);
  }
  rays.a.conservativeResize(count, 3);
  rays.b.conservativeResize(count, 3);
  return rays;
}

Eigen::Matrix3d Cross(const Eigen::Vector3d& t) {
  Eigen::Matrix3d m;
  m << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  return m;
}

Eigen::Matrix3d Essential(const Rigid3& pose) { return Cross(pose.translation_mm) * pose.rotation; }

/// Eq. (1) and, where asked for, its derivatives by the entries that `by_e` moves.
double Distance(const Rays& rays, Eigen::Index i, const Eigen::Matrix3d& e,
                const std::array<Eigen::Matrix3d, 5>* by_e = nullptr,
                Eigen::Matrix<double, 1, 5>* jacobian = nullptr) {
  const Eigen::Vector3d a = rays.a.row(i).transpose(), b = rays.b.row(i).transpose();
  const Eigen::Vector3d line_b = e * a, line_a = e.transpose() * b;
  const double wa = 1 / (rays.f_a * rays.f_a), wb = 1 / (rays.f_b * rays.f_b);
  const double n = b.dot(line_b);
  const double d2 = wb * line_b.head<2>().squaredNorm() + wa * line_a.head<2>().squaredNorm();
  const double d = std::sqrt(d2);
  if (!(d > 0)) return 0.0;
  if (jacobian != nullptr) {
    for (int k = 0; k < 5; ++k) {
      const Eigen::Vector3d db = (*by_e)[k] * a, da = (*by_e)[k].transpose() * b;
      const double half =
          wb * line_b.head<2>().dot(db.head<2>()) + wa * line_a.head<2>().dot(da.head<2>());
      (*jacobian)[k] = b.dot(db) / d - n / (d2 * d) * half;
    }
  }
  return n / d;
}

/// Angle between two rays of one frame.
double Angle(const Eigen::Vector3d& u, const Eigen::Vector3d& v) {
  return std::atan2(u.cross(v).norm(), u.dot(v));
}

/// Whether the rays meet before both cameras, or so far that it cannot be said.
bool MeetInFront(const Rays& rays, Eigen::Index i, const Rigid3& pose, double tolerance_rad) {
  const Eigen::Vector3d a = pose.rotation * rays.a.row(i).transpose();
  const Eigen::Vector3d b = rays.b.row(i).transpose();
  if (Angle(a, b) < tolerance_rad) return true;
  const Eigen::Vector3d across = b.cross(a);
  // depth_b b = depth_a a + t, crossed with b and with a.
  const double depth_a = -across.dot(b.cross(pose.translation_mm));
  const double depth_b = -across.dot(a.cross(pose.translation_mm));
  return depth_a > 0 && depth_b > 0;
}

RelativePose Judge(const Rays& rays, const Rigid3& pose, double threshold_px, bool full) {
  RelativePose result{pose, 0.0, {}, 0, 0.0};
  const Eigen::Matrix3d e = Essential(pose);
  const double tolerance_rad = threshold_px / std::min(rays.f_a, rays.f_b);
  std::vector<double> angles;
  for (Eigen::Index i = 0; i < rays.a.rows(); ++i) {
    const double distance = std::abs(Distance(rays, i, e));
    const bool in = distance < threshold_px && MeetInFront(rays, i, pose, tolerance_rad);
    result.cost_px2 += in ? distance * distance : threshold_px * threshold_px;
    result.inliers += in;
    if (!full) continue;
    result.inlier.push_back(in);
    if (in) {
      angles.push_back(Angle(pose.rotation * rays.a.row(i).transpose(), rays.b.row(i).transpose()));
    }
  }
  result.cost_px2 /= static_cast<double>(rays.a.rows());
  if (!angles.empty()) result.convergence_rad = Median(std::move(angles));
  return result;
}

/// Best first; what differs from a better one in neither rotation nor direction goes.
std::vector<RelativePose> Distinct(std::vector<RelativePose> all, std::size_t count) {
  std::stable_sort(all.begin(), all.end(), [](const RelativePose& x, const RelativePose& y) {
    return x.cost_px2 < y.cost_px2;
  });
  std::vector<RelativePose> kept;
  for (RelativePose& c : all) {
    const bool is_new = std::none_of(kept.begin(), kept.end(), [&](const RelativePose& k) {
      const Rigid3 &p = k.b_from_a, &q = c.b_from_a;
      return VectorFromRotation(p.rotation * q.rotation.transpose()).norm() < kDistinctRad &&
             Angle(p.translation_mm, q.translation_mm) < 3 * kDistinctRad;
    });
    if (is_new) kept.push_back(std::move(c));
    if (kept.size() == count) break;
  }
  return kept;
}

std::array<Eigen::Index, 5> DrawFive(Eigen::Index n, std::mt19937* random) {
  std::array<Eigen::Index, 5> five{};
  for (std::size_t k = 0; k < 5; ++k) {
    do {
      five[k] = static_cast<Eigen::Index>((*random)() % static_cast<std::uint32_t>(n));
    } while (std::find(five.begin(), five.begin() + k, five[k]) != five.begin() + k);
  }
  return five;
}

std::vector<RelativePose> Sample(const Rays& rays, const RelativeOrientationOptions& options) {
  std::mt19937 random(options.seed);
  std::vector<RelativePose> found;
  int most = 0;
  for (int i = 0; i < options.max_samples; ++i) {
    const double share = static_cast<double>(most) / static_cast<double>(rays.a.rows());
    if (i >= 20 && std::pow(1 - std::pow(share, 5), i) < kMissed) break;
    const auto five = DrawFive(rays.a.rows(), &random);
    Eigen::Matrix<double, 3, 5> a, b;
    for (int k = 0; k < 5; ++k) {
      a.col(k) = rays.a.row(five[k]).transpose();
      b.col(k) = rays.b.row(five[k]).transpose();
    }
    for (const Eigen::Matrix3d& e : EssentialFromFive(a, b)) {
      for (const Rigid3& pose : PosesFromEssential(e)) {
        const bool in_front = std::all_of(five.begin(), five.end(), [&](Eigen::Index k) {
          return MeetInFront(rays, k, pose, 1e-9);
        });
        if (!in_front) continue;
        found.push_back(Judge(rays, pose, options.threshold_px, false));
        most = std::max(most, found.back().inliers);
      }
    }
    if (found.size() > 500) found = Distinct(std::move(found), kRefined);
  }
  return Distinct(std::move(found), kRefined);
}

/// dE/d(rotation vector on the left of R, two turns of t on the sphere).
std::array<Eigen::Matrix3d, 5> Derivatives(const Rigid3& pose,
                                           const Eigen::Matrix<double, 3, 2>& tangent) {
  std::array<Eigen::Matrix3d, 5> by;
  const Eigen::Matrix3d t = Cross(pose.translation_mm);
  for (int k = 0; k < 3; ++k) by[k] = t * Cross(Eigen::Vector3d::Unit(k)) * pose.rotation;
  for (int k = 0; k < 2; ++k) by[3 + k] = Cross(tangent.col(k)) * pose.rotation;
  return by;
}

/// Cauchy's loss with `scale_px`, of the pairs within `limit_px`.
double Loss(const Rays& rays, const Rigid3& pose, double scale_px, double limit_px) {
  const Eigen::Matrix3d e = Essential(pose);
  double loss = 0.0;
  const double s2 = scale_px * scale_px;
  for (Eigen::Index i = 0; i < rays.a.rows(); ++i) {
    const double d = std::min(limit_px, std::abs(Distance(rays, i, e)));
    loss += s2 * std::log1p(d * d / s2);
  }
  return loss;
}

/// Levenberg-Marquardt over the five unknowns; what lies beyond `limit_px` is set aside.
void Refine(const Rays& rays, double scale_px, double limit_px, Rigid3* pose) {
  double damping = 1e-6, loss = Loss(rays, *pose, scale_px, limit_px);
  for (int iteration = 0; iteration < 30 && damping < 1e6; ++iteration) {
    const Eigen::Vector3d t = pose->translation_mm;
    Eigen::Matrix<double, 3, 2> tangent;
    tangent.col(0) = t.unitOrthogonal();
    tangent.col(1) = t.cross(tangent.col(0));
    const auto by_e = Derivatives(*pose, tangent);
    const Eigen::Matrix3d e = Essential(*pose);
    Eigen::Matrix<double, 5, 5> normal = Eigen::Matrix<double, 5, 5>::Zero();
    Eigen::Matrix<double, 5, 1> right = Eigen::Matrix<double, 5, 1>::Zero();
    for (Eigen::Index i = 0; i < rays.a.rows(); ++i) {
      Eigen::Matrix<double, 1, 5> j;
      const double d = Distance(rays, i, e, &by_e, &j);
      if (!(std::abs(d) < limit_px)) continue;
      const double weight = 1 / (1 + d * d / (scale_px * scale_px));
      normal += weight * j.transpose() * j;
      right -= weight * j.transpose() * d;
    }
    normal.diagonal() *= 1 + damping;
    const Eigen::Matrix<double, 5, 1> step = normal.ldlt().solve(right);
    if (!step.allFinite()) return;
    const Rigid3 trial{NearestRotation(RotationFromVector(step.head<3>()) * pose->rotation),
                       (t + tangent * step.tail<2>()).normalized()};
    const double after = Loss(rays, trial, scale_px, limit_px);
    if (!(after < loss)) {
      damping *= 10;
      continue;
    }
    const bool done = loss - after < 1e-10 * loss;
    *pose = trial;
    loss = after;
    damping = std::max(1e-9, damping / 10);
    if (done) return;
  }
}

/// Standard deviation of an image coordinate from the median of the inliers' distances.
double NoisePx(const Rays& rays, const RelativePose& pose) {
  const Eigen::Matrix3d e = Essential(pose.b_from_a);
  std::vector<double> squares;
  for (Eigen::Index i = 0; i < rays.a.rows(); ++i) {
    if (pose.inlier[i]) squares.push_back(std::pow(Distance(rays, i, e), 2));
  }
  const double n = static_cast<double>(squares.size());
  if (n < kMinPairs) return kMinNoisePx;
  // Five unknowns take their share of the residuals.
  return std::max(kMinNoisePx,
                  std::sqrt(Median(std::move(squares)) / kMedianChi2One * n / (n - 5)));
}

/// The robust passes, then plain least squares over what agrees.
RelativePose Polish(const Rays& rays, Rigid3 pose, double threshold_px) {
  Refine(rays, 0.5 * threshold_px, HUGE_VAL, &pose);
  Refine(rays, 0.1 * threshold_px, HUGE_VAL, &pose);
  for (int round = 0; round < 2; ++round) {
    const RelativePose judged = Judge(rays, pose, threshold_px, true);
    const double limit = std::min(threshold_px, kGateSigmas * NoisePx(rays, judged));
    Refine(rays, 1e3 * threshold_px, limit, &pose);  // so wide a scale is least squares
  }
  return Judge(rays, pose, threshold_px, true);
}

std::vector<Rigid3> PlaneMotions(const Rays& rays, const RelativePose& best) {
  Points2d a(best.inliers, 2), b(best.inliers, 2);
  Eigen::MatrixX3d ray_a(best.inliers, 3), ray_b(best.inliers, 3);
  Eigen::Index k = 0;
  for (Eigen::Index i = 0; i < rays.a.rows(); ++i) {
    if (!best.inlier[i]) continue;
    ray_a.row(k) = rays.a.row(i);
    ray_b.row(k) = rays.b.row(i);
    a.row(k) = rays.a.row(i).head<2>();
    b.row(k++) = rays.b.row(i).head<2>();
  }
  if (k < 4) return {};
  const auto homography = FitHomography(a, b);
  if (!homography) return {};
  return PosesFromPlane(*homography, ray_a, ray_b);
}

/// The rotation alone that leaves the least median distance: two rays a sample,
/// then all within three medians. Returns the median of the squared distances, px2.
double FitRotation(const Rays& rays, std::uint32_t seed, Eigen::Matrix3d* rotation) {
  std::mt19937 random(seed);
  const Eigen::Index n = rays.a.rows();
  const Eigen::MatrixX3d a = rays.a.rowwise().normalized(), b = rays.b.rowwise().normalized();
  const double f2 = 0.5 * rays.f_a * rays.f_b;  // half: both pictures' noise
  auto squares = [&](const Eigen::Matrix3d& r) {
    std::vector<double> all;
    for (Eigen::Index i = 0; i < n; ++i) {
      const Eigen::Vector3d p = r * rays.a.row(i).transpose();
      const Eigen::Vector2d q = rays.b.row(i).head<2>().transpose();
      all.push_back(p.z() > 0 ? f2 * (p.head<2>() / p.z() - q).squaredNorm() : HUGE_VAL);
    }
    return all;
  };
  auto kabsch = [&](const Eigen::MatrixX3d& to, const Eigen::MatrixX3d& from) {
    return NearestRotation(to.transpose() * from);
  };
  double best = HUGE_VAL;
  for (int sample = 0; sample < 50; ++sample) {
    Eigen::MatrixX3d from(2, 3), to(2, 3);
    for (int k = 0; k < 2; ++k) {
      const auto i = static_cast<Eigen::Index>(random() % static_cast<std::uint32_t>(n));
      from.row(k) = a.row(i);
      to.row(k) = b.row(i);
    }
    const Eigen::Matrix3d r = kabsch(to, from);
    const double median = Median(squares(r));
    if (median < best) {
      best = median;
      *rotation = r;
    }
  }
  for (int round = 0; round < 5; ++round) {
    const std::vector<double> all = squares(*rotation);
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (Eigen::Index i = 0; i < n; ++i) {
      if (all[i] <= 9 * best) sum += b.row(i).transpose() * a.row(i);
    }
    const Eigen::Matrix3d r = NearestRotation(sum);
    const double median = Median(squares(r));
    if (!(median < best)) break;
    best = median;
    *rotation = r;
  }
  return best;
}

/// The best two motions of random fives, of `known` ones and of the best one's plane.
std::vector<RelativePose> FindMotions(const Rays& rays, const RelativeOrientationOptions& options,
                                      std::vector<RelativePose> known) {
  const double threshold = options.threshold_px;
  for (const RelativePose& start : Sample(rays, options)) known.push_back(start);
  for (RelativePose& c : known) c = Polish(rays, c.b_from_a, threshold);
  if (known.empty()) return known;
  known = Distinct(std::move(known), kRefined);
  for (const Rigid3& pose : PlaneMotions(rays, known.front())) {
    known.push_back(Polish(rays, pose, threshold));
  }
  return Distinct(std::move(known), 2);
}

}  // namespace

RelativeOrientation OrientRelatively(const Camera& camera_a,
                                     const Eigen::Ref<const Points2d>& pixels_a,
                                     const Camera& camera_b,
                                     const Eigen::Ref<const Points2d>& pixels_b,
                                     const RelativeOrientationOptions& options) {
  if (pixels_a.rows() != pixels_b.rows()) {
    throw std::invalid_argument("OrientRelatively: " + std::to_string(pixels_a.rows()) +
                                " pixels of a but " + std::to_string(pixels_b.rows()) + " of b");
  }
  RelativeOrientation result;
  const Rays rays = UsableRays(camera_a, pixels_a, camera_b, pixels_b);
  if (rays.a.rows() < kMinPairs) return result;
  const double threshold = options.threshold_px;
  std::vector<RelativePose> refined = FindMotions(rays, options, {});
  // Again with gates of the noise found: where the geometry is weak (a plane), a
  // motion bent by several standard deviations to take in one wrong pair costs
  // less than the pair gains in a wide gate.
  for (int round = 0; round < kTighter && !refined.empty(); ++round) {
    RelativeOrientationOptions tighter = options;
    tighter.threshold_px = std::min(threshold, kGateSigmas * NoisePx(rays, refined.front()));
    refined = FindMotions(rays, tighter, std::move(refined));
  }
  if (refined.empty()) return result;
  for (RelativePose& c : refined) c = Judge(rays, c.b_from_a, threshold, true);
  const double noise_px = NoisePx(rays, refined.front());
  result.parallax =
      std::sqrt(FitRotation(rays, options.seed, &result.rotation) / kMedianChi2Two) / noise_px;
  result.has_baseline = result.parallax >= options.min_parallax;
  if (!result.has_baseline || refined.front().inliers < kMinPairs) return result;
  // The twin of a plane fits as well; any other second minimum does not.
  const double worst_px2 = std::max(4 * refined.front().cost_px2, 2 * noise_px * noise_px);
  std::erase_if(refined, [&](const RelativePose& c) { return c.cost_px2 > worst_px2; });
  for (RelativePose& c : refined) {
    std::vector<bool> inlier(static_cast<std::size_t>(pixels_a.rows()), false);
    for (std::size_t i = 0; i < rays.row.size(); ++i) inlier[rays.row[i]] = c.inlier[i];
    c.inlier = std::move(inlier);
    result.candidates.push_back(std::move(c));
  }
  return result;
}

}  // namespace videogrammetry
