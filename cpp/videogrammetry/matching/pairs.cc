#include "videogrammetry/matching/pairs.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace videogrammetry {
namespace {

// Of a curve within the pictures, and of the search for its range.
constexpr int kCurveSteps = 8, kRangeSteps = 40, kRangeRays = 5;
// Enough to tell how large the space is.
constexpr std::size_t kVolumePairs = 1000, kVolumeTargets = 100;

// For b_from_a = (R, t): E = [t]_x R.
Eigen::Matrix3d EssentialMatrix(const OrientedCamera& a, const OrientedCamera& b) {
  const Rigid3 b_from_a = b.cam_from_world * a.cam_from_world.Inverse();
  const Eigen::Vector3d& t = b_from_a.translation_mm;
  Eigen::Matrix3d cross;
  cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  return cross * b_from_a.rotation;
}

// Rays of a grid over a's picture, in geometric steps from a twentieth of the base to ten
// times it, unless the user states the range; a step more at either end.
void SetRange(const CameraView& a, const CameraView& b, const MatchingOptions& options,
              CameraPair* pair) {
  const double away = (b.center() - a.center()).norm();
  const double least = options.min_distance_mm > 0 ? 0.5 * options.min_distance_mm : 0.05 * away;
  const double most = options.max_distance_mm > 0 ? options.max_distance_mm : 10.0 * away;
  const double factor = std::pow(most / least, 1.0 / kRangeSteps);
  pair->least_mm = most;
  pair->most_mm = least;
  const Camera& camera = a.oriented().camera;
  for (int ray = 0; ray < kRangeRays * kRangeRays; ++ray) {
    const double u = static_cast<double>(ray % kRangeRays) / (kRangeRays - 1);
    const double v = static_cast<double>(ray / kRangeRays) / (kRangeRays - 1);
    const auto along = RayFromPixel(
        a.oriented(), Eigen::Vector2d(u * (camera.width_px - 1), v * (camera.height_px - 1)));
    if (!along) continue;
    double t = least;
    for (int k = 0; k <= kRangeSteps; ++k, t *= factor) {
      Eigen::Vector2d xy;
      if (!b.Project(along->origin_mm + t * along->direction, &xy) || !b.InPicture(xy)) continue;
      pair->least_mm = std::min(pair->least_mm, t / factor);
      pair->most_mm = std::max(pair->most_mm, t * factor);
    }
  }
}

// The miss (o_b - o_a) . (u_a x u_b) of two rays, 0 where they meet, within the gate?
bool RaysMeet(const TargetView& a, std::size_t i, const TargetView& b, std::size_t j,
              double gate2) {
  const Eigen::Vector3d u = a.direction(i), v = b.direction(j);
  const Eigen::Vector3d between = b.origin(j) - a.origin(i), across = u.cross(v);
  const Eigen::Vector2d by_a =
      a.direction_by_xy(i).transpose() * v.cross(between) - a.origin_by_xy(i).transpose() * across;
  const Eigen::Vector2d by_b =
      b.direction_by_xy(j).transpose() * between.cross(u) + b.origin_by_xy(j).transpose() * across;
  const double miss = between.dot(across);
  return miss * miss <= gate2 * (by_a.dot(a.cov(i) * by_a) + by_b.dot(b.cov(j) * by_b));
}

}  // namespace

std::vector<CameraPair> CameraPairs(const std::vector<CameraView>& cameras,
                                    const MatchingOptions& options) {
  std::vector<CameraPair> pairs;
  for (std::size_t a = 0; a < cameras.size(); ++a) {
    for (std::size_t b = a + 1; b < cameras.size(); ++b) {
      CameraPair pair;
      pair.a = a;
      pair.b = b;
      pair.curved = cameras[a].has_window() || cameras[b].has_window();
      if (pair.curved) {
        SetRange(cameras[a], cameras[b], options, &pair);
      } else {
        pair.essential = EssentialMatrix(cameras[a].oriented(), cameras[b].oriented());
      }
      pairs.push_back(pair);
    }
  }
  return pairs;
}

bool PairFinder::Passes(const CameraPair& pair, std::size_t i, std::size_t j) const {
  const double gate2 = critical_value_ * critical_value_;
  const TargetView &own = targets_[pair.a], &other = targets_[pair.b];
  if (pair.curved) {
    const bool both = cameras_[pair.a].has_window() && cameras_[pair.b].has_window();
    return !both || RaysMeet(own, i, other, j, gate2);  // one only: judged when adjusted
  }
  const Eigen::Vector3d x(own.xy(i).x(), own.xy(i).y(), 1);
  const Eigen::Vector3d y(other.xy(j).x(), other.xy(j).y(), 1);
  const Eigen::Vector3d line = pair.essential * x;
  const Eigen::Vector2d by_b = line.head<2>();
  const Eigen::Vector2d by_a = pair.essential.leftCols<2>().transpose() * y;
  const double distance = line.dot(y);
  return distance * distance <=
         gate2 * (by_b.dot(other.cov(j) * by_b) + by_a.dot(own.cov(i) * by_a));
}

void PairFinder::Partners(const CameraPair& pair, std::size_t i, const FreeTargets& free,
                          std::vector<int>* near) const {
  near->clear();
  if (!free[pair.a][i] || !targets_[pair.a].valid(i)) return;
  if (pair.curved) {
    AlongCurve(pair, i, free, near);
  } else {
    AlongLine(pair, i, free, near);
  }
  const TargetView& other = targets_[pair.b];
  for (const int k : other.wide()) {
    const auto j = static_cast<std::size_t>(k);
    if (free[pair.b][j] && IdsAgree(data_[pair.a].id[i], data_[pair.b].id[j]) &&
        Passes(pair, i, j)) {
      near->push_back(k);
    }
  }
  std::sort(near->begin(), near->end());
  near->erase(std::unique(near->begin(), near->end()), near->end());
}

void PairFinder::AlongLine(const CameraPair& pair, std::size_t i, const FreeTargets& free,
                           std::vector<int>* near) const {
  const TargetView &own = targets_[pair.a], &other = targets_[pair.b];
  const Eigen::Vector3d line = pair.essential * Eigen::Vector3d(own.xy(i).x(), own.xy(i).y(), 1.0);
  const double norm = line.head<2>().norm();
  if (!(norm > 0)) return;
  const Eigen::Vector3d unit = line / norm;
  const Eigen::Vector2d foot = -unit.z() * unit.head<2>();
  const Eigen::Vector2d along(-unit.y(), unit.x());
  // Across the picture: 2 is more than any half diagonal of a lens without a fold.
  const double half = 2.0 + foot.norm();
  double most = 0;
  for (const double t : {-1.0, 1.0}) {
    const Eigen::Vector2d end = foot + t * std::min(half, 2.0) * along;
    most = std::max(
        most,
        (pair.essential.leftCols<2>().transpose() * Eigen::Vector3d(end.x(), end.y(), 1)).norm());
  }
  const double sigma_a = std::sqrt(own.cov(i).diagonal().maxCoeff());
  const double reach = critical_value_ * std::hypot(sigma_a * most / norm, 1.5 * other.max_sigma());
  other.ForSegment(foot - half * along, foot + half * along, reach, [&](std::size_t j) {
    // The cheapest test first: most targets of the cells are far from the line.
    const Eigen::Vector2d& xy = other.xy(j);
    if (std::abs(unit.x() * xy.x() + unit.y() * xy.y() + unit.z()) > reach || !free[pair.b][j] ||
        !IdsAgree(data_[pair.a].id[i], data_[pair.b].id[j])) {
      return;
    }
    if (Passes(pair, i, j)) near->push_back(static_cast<int>(j));
  });
}

void PairFinder::AlongCurve(const CameraPair& pair, std::size_t i, const FreeTargets& free,
                            std::vector<int>* near) const {
  if (!(pair.least_mm < pair.most_mm)) return;
  const TargetView &own = targets_[pair.a], &other = targets_[pair.b];
  const Eigen::Vector3d origin = own.origin(i), direction = own.direction(i).normalized();
  std::array<Eigen::Vector2d, kCurveSteps + 1> curve;
  int count = 0;
  double t = pair.least_mm;
  const double factor = std::pow(pair.most_mm / pair.least_mm, 1.0 / kCurveSteps);
  for (int k = 0; k <= kCurveSteps; ++k, t *= factor) {
    Eigen::Vector2d& xy = curve[static_cast<std::size_t>(count)];
    if (cameras_[pair.b].Project(origin + t * direction, &xy)) ++count;
  }
  // The deviation of an arc from its chord is an eighth of the second difference: here
  // from twice as much, as the steps are not equal.
  double bend = 0;
  for (int k = 2; k < count; ++k) {
    const auto n = static_cast<std::size_t>(k);
    const Eigen::Vector2d first = curve[n - 1] - curve[n - 2], last = curve[n] - curve[n - 1];
    const double cross = first.x() * last.y() - first.y() * last.x();
    bend = std::max(bend, std::abs(cross) / std::max(first.norm() + last.norm(), 1e-12));
  }
  const double sigma_a = std::sqrt(own.cov(i).diagonal().maxCoeff());
  const double reach = critical_value_ * std::hypot(1.5 * sigma_a, 1.5 * other.max_sigma()) + bend;
  for (int k = 1; k < count; ++k) {
    const Eigen::Vector2d from = curve[static_cast<std::size_t>(k) - 1];
    const Eigen::Vector2d to = curve[static_cast<std::size_t>(k)];
    const double length = std::max((to - from).norm(), 1e-12);
    const Eigen::Vector2d across = Eigen::Vector2d(from.y() - to.y(), to.x() - from.x()) / length;
    const double at = across.dot(from);
    other.ForSegment(from, to, reach, [&](std::size_t j) {
      if (std::abs(across.dot(other.xy(j)) - at) > reach || !free[pair.b][j] ||
          !IdsAgree(data_[pair.a].id[i], data_[pair.b].id[j])) {
        return;
      }
      if (Passes(pair, i, j)) near->push_back(static_cast<int>(j));
    });
  }
}

double PairFinder::Volume(const FreeTargets& free) const {
  std::array<std::vector<double>, 3> along;
  std::vector<int> near;
  for (const CameraPair& pair : pairs_) {
    const TargetView &own = targets_[pair.a], &other = targets_[pair.b];
    for (std::size_t i = 0; i < own.size(); i += own.size() / kVolumeTargets + 1) {
      Partners(pair, i, free, &near);
      for (const int j : near) {
        Eigen::Vector3d position;
        if (!MeetingPoint(own, i, other, static_cast<std::size_t>(j), &position)) continue;
        for (int k = 0; k < 3; ++k) along[static_cast<std::size_t>(k)].push_back(position[k]);
      }
    }
    if (along[0].size() >= kVolumePairs) break;
  }
  double volume = 1;
  for (auto& values : along) {
    if (values.size() < 4) return 1e9;
    std::sort(values.begin(), values.end());
    const std::size_t n = values.size();
    volume *= std::max(2 * (values[3 * n / 4] - values[n / 4]), 1e-3);
  }
  return volume;
}

}  // namespace videogrammetry
