#include "videogrammetry/matching/statistics.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <bit>
#include <cmath>

namespace videogrammetry {
namespace {

// The detections' prior: as if so many points had been looked at.
constexpr double kPriorCount = 4.0;
constexpr double kPriorSeen = 0.85;
constexpr double kLeastSeen = 0.005, kMostSeen = 0.995;
// A box is no flatter than this share of its longest side: points on a panel are near it.
constexpr double kFlattest = 0.05;
constexpr double kFewPoints = 5.0;
// Detections are counted on points of this probability: among many unlikely pairs, most of
// them chance, no camera seems to see what another does.
constexpr double kProven = 0.9;
// Lone targets are this share of all at least.
constexpr double kLeastLone = 0.02;
// Targets in a row fill no area; they are taken to fill this share of the picture.
constexpr double kSmallestPart = 0.1;

// Sums of the weighted points' positions.
struct Cloud {
  double count = 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d square = Eigen::Matrix3d::Zero();

  void Add(const Eigen::Vector3d& position, double weight) {
    count += weight;
    sum += weight * position;
    square += weight * position * position.transpose();
  }
  // Of a box with these moments: a uniform one's variance is its length squared over 12.
  double Volume(Eigen::Matrix3d* information) const {
    const Eigen::Vector3d mean = sum / count;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(square / count -
                                                              mean * mean.transpose());
    Eigen::Vector3d side = (12 * axes.eigenvalues().cwiseMax(0.0)).cwiseSqrt();
    side = side.cwiseMax(std::max(kFlattest * side.maxCoeff(), 1e-3));
    *information = axes.eigenvectors() * (12 / side.array().square()).matrix().asDiagonal() *
                   axes.eigenvectors().transpose();
    return side.prod();
  }
};

// Targets of no match of one camera: how many, and a normalised picture's area with their
// moments. With few of them the picture's other targets say where they would be.
struct LoneTargets {
  std::vector<double> share;  // a target: that it is of no match

  explicit LoneTargets(const TargetView& view) : share(view.size(), 1.0) {}

  double LogDensity(const TargetView& view, double picture_area) const {
    double count = 0, weights = 0;
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
    const double prior = kFewPoints / std::max(static_cast<double>(view.size()), 1.0);
    for (std::size_t t = 0; t < view.size(); ++t) {
      const double own = std::max(share[t], 0.0);
      count += own;
      if (!view.valid(t)) continue;
      weights += own + prior;
      sum += (own + prior) * view.xy(t);
      square += (own + prior) * view.xy(t) * view.xy(t).transpose();
    }
    double area = picture_area;
    if (static_cast<double>(view.size()) >= kFewPoints && weights > 0) {
      const Eigen::Vector2d mean = sum / weights;
      const double moments = (square / weights - mean * mean.transpose()).determinant();
      area = std::clamp(12 * std::sqrt(std::max(moments, 0.0)), kSmallestPart * picture_area,
                        picture_area);
    }
    const double least = kLeastLone * static_cast<double>(view.size());
    return std::log((std::max(count, least) + 1.0) / area);
  }
};

void CountDetections(const Candidate& candidate, double weight, Eigen::MatrixXd* hits,
                     Eigen::MatrixXd* trials) {
  for (const ViewTarget& s : candidate.used) {
    if (candidate.size() < 3) break;
    for (const ViewTarget& o : candidate.used) {
      if (o.camera == s.camera) continue;
      (*hits)(s.camera, o.camera) += weight;
      (*trials)(s.camera, o.camera) += weight;
    }
  }
  for (std::uint64_t left = candidate.in_view; left != 0; left &= left - 1) {
    const int c = std::countr_zero(left);
    for (const ViewTarget& o : candidate.used) (*trials)(c, o.camera) += weight;
  }
}

}  // namespace

StageStatistics EstimateStatistics(const std::vector<CameraView>& cameras,
                                   const std::vector<TargetView>& targets,
                                   const std::vector<Candidate>& candidates,
                                   const std::vector<Candidate>& known,
                                   const StageStatistics& before) {
  const auto n = static_cast<Eigen::Index>(cameras.size());
  Eigen::MatrixXd hits = Eigen::MatrixXd::Constant(n, n, kPriorCount * kPriorSeen);
  Eigen::MatrixXd trials = Eigen::MatrixXd::Constant(n, n, kPriorCount);
  std::vector<LoneTargets> lone;
  for (const TargetView& t : targets) lone.emplace_back(t);
  Cloud cloud;
  const auto count = [&](const Candidate& candidate, double weight) {
    if (weight < 1e-3) return;
    for (const ViewTarget& s : candidate.used) {
      lone[static_cast<std::size_t>(s.camera)].share[static_cast<std::size_t>(s.target)] -= weight;
    }
    cloud.Add(candidate.point.position_mm, weight);
    if (cameras.size() > 2 && weight > kProven) {
      CountDetections(candidate, weight, &hits, &trials);
    }
  };
  for (const Candidate& candidate : candidates) count(candidate, candidate.probability);
  for (const Candidate& candidate : known) count(candidate, 1.0);

  StageStatistics statistics = before;
  statistics.seen = hits.cwiseQuotient(trials).cwiseMax(kLeastSeen).cwiseMin(kMostSeen);
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    statistics.log_lone[c] = lone[c].LogDensity(targets[c], cameras[c].area());
  }
  if (cloud.count >= kFewPoints) {
    statistics.log_density = std::log(cloud.count / cloud.Volume(&statistics.box_information));
  }
  return statistics;
}

}  // namespace videogrammetry
