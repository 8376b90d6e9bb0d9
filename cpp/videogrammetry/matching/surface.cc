#include "videogrammetry/matching/surface.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

namespace videogrammetry {
namespace {

constexpr double kNoSurface = 0.8;
constexpr std::size_t kMostJudged = 64, kFewJudged = 8;
constexpr int kMinNeighbours = 5;  // an affine function has 3 unknowns; two to judge it
constexpr int kReweightings = 3;
constexpr double kMinTriangle = 0.02;  // twice its area, in units of the neighbours' reach

struct Sample {
  Eigen::Vector2d pixel;
  double inverse_depth;
  double variance;
};

struct Prediction {
  double inverse_depth;
  double sigma;
};

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Weights of Tukey's biweight around a given affine function.
Eigen::VectorXd TukeyWeights(const Eigen::VectorXd& residual, double limit) {
  Eigen::VectorXd weight(residual.size());
  for (Eigen::Index i = 0; i < residual.size(); ++i) {
    const double u = residual[i] / limit;
    weight[i] = std::abs(u) < 1 ? (1 - u * u) * (1 - u * u) : 0.0;
  }
  return weight;
}

// MAD to sigma, widened for the three unknowns that the fit has spent.
double Scatter(const Eigen::VectorXd& residual) {
  std::vector<double> sizes(residual.data(), residual.data() + residual.size());
  for (double& r : sizes) r = std::abs(r);
  const auto n = static_cast<double>(residual.size());
  return 1.4826 * Median(std::move(sizes)) * std::sqrt(n / (n - 3.0));
}

// The affine function through three samples that the median sample fits best
// (least median of squares, Rousseeuw 1984): a start that almost half of the
// samples, lying on another surface, cannot bend.
bool LeastMedianStart(const Eigen::MatrixX3d& design, const Eigen::VectorXd& value,
                      Eigen::Vector3d* solution) {
  const Eigen::Index n = design.rows();
  double best = std::numeric_limits<double>::infinity();
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = i + 1; j < n; ++j) {
      for (Eigen::Index k = j + 1; k < n; ++k) {
        Eigen::Matrix3d rows;
        rows << design.row(i), design.row(j), design.row(k);
        if (std::abs(rows.determinant()) < kMinTriangle) continue;  // nearly in one line
        const Eigen::Vector3d trial =
            rows.inverse() * Eigen::Vector3d(value[i], value[j], value[k]);
        const double scatter = Scatter(value - design * trial);
        if (scatter < best) {
          best = scatter;
          *solution = trial;
        }
      }
    }
  }
  return std::isfinite(best);
}

// Affine fit of the samples' inverse depth, evaluated at `pixel`.
bool PredictInverseDepth(const std::vector<Sample>& samples, const Eigen::Vector2d& pixel,
                         Prediction* prediction) {
  const auto n = static_cast<Eigen::Index>(samples.size());
  if (n < kMinNeighbours) return false;
  double reach = 1.0, noise = 0.0;
  for (const Sample& s : samples) {
    reach = std::max(reach, (s.pixel - pixel).norm());
    noise += s.variance / static_cast<double>(n);
  }
  Eigen::MatrixX3d design(n, 3);
  Eigen::VectorXd value(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Sample& s = samples[static_cast<std::size_t>(i)];
    design.row(i) << 1.0, (s.pixel - pixel).transpose() / reach;
    value[i] = s.inverse_depth;
  }
  Eigen::Vector3d solution;
  if (!LeastMedianStart(design, value, &solution)) return false;
  Eigen::VectorXd weight;
  Eigen::Matrix3d normal;
  double scatter = 0;
  for (int round = 0; round < kReweightings; ++round) {
    const Eigen::VectorXd residual = value - design * solution;
    scatter = Scatter(residual);
    weight = TukeyWeights(residual, 4.685 * std::max(scatter, std::sqrt(noise)));
    normal = design.transpose() * weight.asDiagonal() * design;
    const Eigen::LDLT<Eigen::Matrix3d> solver(normal);
    if (solver.info() != Eigen::Success || !(solver.vectorD().minCoeff() > 1e-6)) return false;
    solution = solver.solve(design.transpose() * weight.asDiagonal() * value);
  }
  const double leverage = normal.inverse()(0, 0);
  prediction->inverse_depth = solution[0];
  prediction->sigma = std::sqrt((scatter * scatter + noise) * (1.0 + leverage));
  return true;
}

double InverseDepth(const CameraView& camera, const Eigen::Vector3d& position) {
  return 1.0 / camera.depth_mm(position);
}

// Variance of the inverse depth from the point's covariance.
double InverseDepthVariance(const CameraView& camera, const Eigen::Vector3d& position,
                            const Eigen::Matrix3d& cov) {
  const Eigen::Vector3d axis = camera.rotation().row(2).transpose();
  const double w = InverseDepth(camera, position);
  return w * w * w * w * axis.dot(cov * axis);
}

std::vector<Sample> Nearest(const CameraView& view, const CameraTargets& targets,
                            std::size_t camera, const std::vector<ReliablePoint>& reliable, int own,
                            int neighbours) {
  const Eigen::Vector2d pixel = targets.xy_px[static_cast<std::size_t>(own)];
  std::vector<std::pair<double, const ReliablePoint*>> near;
  for (const ReliablePoint& point : reliable) {
    const int t = point.target[camera];
    if (t < 0 || t == own) continue;
    near.emplace_back((targets.xy_px[static_cast<std::size_t>(t)] - pixel).squaredNorm(), &point);
  }
  const std::size_t count = std::min(near.size(), static_cast<std::size_t>(neighbours));
  std::partial_sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(count), near.end());
  std::vector<Sample> samples;
  for (std::size_t i = 0; i < count; ++i) {
    const ReliablePoint& point = *near[i].second;
    samples.push_back({targets.xy_px[static_cast<std::size_t>(point.target[camera])],
                       InverseDepth(view, point.position_mm),
                       InverseDepthVariance(view, point.position_mm, point.cov_mm2)});
  }
  return samples;
}

// N(d; s) R of a point in one camera; nothing where the neighbours predict nothing.
std::optional<double> DensityRatio(const CameraView& view, const CameraTargets& targets,
                                   const StageStatistics& statistics,
                                   const std::vector<ReliablePoint>& reliable,
                                   const ViewTarget& own, const Eigen::Vector3d& position,
                                   const Eigen::Matrix3d& cov, int neighbours) {
  Prediction prediction;
  if (!PredictInverseDepth(Nearest(view, targets, static_cast<std::size_t>(own.camera), reliable,
                                   own.target, neighbours),
                           targets.xy_px[static_cast<std::size_t>(own.target)], &prediction)) {
    return std::nullopt;
  }
  const double w = InverseDepth(view, position);
  const double sigma =
      std::hypot(prediction.sigma, std::sqrt(InverseDepthVariance(view, position, cov)));
  const double u = (w - prediction.inverse_depth) / sigma;
  const Eigen::Vector3d along = (position - view.center()).normalized();
  const double across = along.dot(statistics.box_information * along);
  const double slope = view.rotation().row(2).dot(along);
  // A uniform distribution's variance is its length squared over 12.
  const double range = w * w * std::abs(slope) * std::sqrt(12 / std::max(across, 1e-300));
  return range * std::exp(-0.5 * u * u) / (std::sqrt(2 * std::numbers::pi) * sigma);
}

// Share of the reliable points that lie on no surface of their neighbours.
double ShareOffSurface(const std::vector<CameraView>& cameras, std::span<const CameraTargets> data,
                       const StageStatistics& statistics,
                       const std::vector<ReliablePoint>& reliable, int neighbours) {
  std::vector<double> ratios;
  const std::size_t step = std::max<std::size_t>(1, reliable.size() / kMostJudged);
  for (std::size_t k = 0; k < reliable.size(); k += step) {
    const ReliablePoint& point = reliable[k];
    const auto first =
        std::find_if(point.target.begin(), point.target.end(), [](int t) { return t >= 0; });
    const auto c = static_cast<std::size_t>(first - point.target.begin());
    const auto ratio =
        DensityRatio(cameras[c], data[c], statistics, reliable, {static_cast<int>(c), *first},
                     point.position_mm, point.cov_mm2, neighbours);
    if (ratio) ratios.push_back(*ratio);
  }
  if (ratios.size() < kFewJudged) return 1.0;
  double share = 0.2;
  for (int round = 0; round < 20; ++round) {
    double off = 1.0;  // one more, so that it is never none
    for (const double r : ratios) off += share / (share + (1 - share) * r);
    share = off / static_cast<double>(ratios.size() + 1);
  }
  return share;
}

}  // namespace

bool SetSurfaceScores(const std::vector<CameraView>& cameras, std::span<const CameraTargets> data,
                      const StageStatistics& statistics, const std::vector<ReliablePoint>& reliable,
                      int neighbours, std::vector<Candidate>* candidates) {
  for (Candidate& candidate : *candidates) candidate.surface_score = 0;
  if (reliable.size() < kFewJudged || statistics.box_information.isZero(0)) return false;
  const double off = ShareOffSurface(cameras, data, statistics, reliable, neighbours);
  if (off > kNoSurface) return false;
  for (Candidate& candidate : *candidates) {
    // Each candidate is judged in its first camera: the evidence is one.
    const ViewTarget& own = candidate.used.front();
    const auto c = static_cast<std::size_t>(own.camera);
    const auto ratio =
        DensityRatio(cameras[c], data[c], statistics, reliable, own, candidate.point.position_mm,
                     candidate.point.cov_mm2(), neighbours);
    if (ratio) candidate.surface_score = std::log((1 - off) * *ratio + off);
  }
  return true;
}

}  // namespace videogrammetry
