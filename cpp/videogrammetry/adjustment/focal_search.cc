#include "videogrammetry/adjustment/focal_search.h"

#include <algorithm>
#include <cmath>

#include "videogrammetry/adjustment/homography.h"
#include "videogrammetry/core/errors.h"

namespace videogrammetry {
namespace {

/// Of the threshold: residuals under this are lens distortion and noise, not a wrong f.
constexpr double kGoodShare = 0.1;

struct Trial {
  double f_px = 0.0;
  double cost_px2 = HUGE_VAL;  // mean over the pictures
  std::vector<Rigid3> poses;   // one a picture
  std::vector<bool> has_pose;
};

Camera WithFocal(Camera camera, double f_px) {
  camera.interior[kF] = f_px;
  return camera;
}

Trial ResectAll(const Camera& camera, const std::vector<ResectionView>& views, double f_px,
                double threshold_px) {
  Trial trial;
  trial.f_px = f_px;
  trial.cost_px2 = 0.0;
  ResectionOptions options;
  options.threshold_px = threshold_px;
  options.num_samples = 30;
  for (const ResectionView& view : views) {
    const auto found = Resect(WithFocal(camera, f_px), view.points_mm, view.pixels, options);
    trial.has_pose.push_back(!found.empty());
    trial.poses.push_back(found.empty() ? Rigid3() : found.front().cam_from_object);
    trial.cost_px2 += found.empty() ? threshold_px * threshold_px : found.front().cost_px2;
  }
  trial.cost_px2 /= static_cast<double>(views.size());
  return trial;
}

/// The trial's poses carried to another f and refined there.
Trial Follow(const Camera& camera, const std::vector<ResectionView>& views, const Trial& from,
             double f_px, double threshold_px) {
  Trial trial = from;
  trial.f_px = f_px;
  trial.cost_px2 = 0.0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    double cost = threshold_px * threshold_px;
    if (from.has_pose[i]) {
      const ResectionView& view = views[i];
      const Points2d ideal = IdealPoints(WithFocal(camera, f_px), view.pixels);
      // The picture's size stays when the distance follows f.
      trial.poses[i].translation_mm *= f_px / from.f_px;
      RefinePose(view.points_mm, ideal, f_px, 0.1 * threshold_px, &trial.poses[i]);
      cost = 0.0;
      for (Eigen::Index k = 0; k < ideal.rows(); ++k) {
        const Eigen::Vector3d p = trial.poses[i] * view.points_mm.row(k).transpose();
        const double e2 =
            p.z() > 0 ? (f_px * p.head<2>() / p.z() - ideal.row(k).transpose()).squaredNorm()
                      : HUGE_VAL;
        cost += std::min(e2, threshold_px * threshold_px);
      }
      cost /= static_cast<double>(ideal.rows());
    }
    trial.cost_px2 += cost / static_cast<double>(views.size());
  }
  return trial;
}

/// What single pictures of thick targets (DLT) and several of flat ones (Zhang) tell of f.
std::vector<double> DirectSolutions(const Camera& camera, const std::vector<ResectionView>& views) {
  const double side = std::max(camera.width_px, camera.height_px);
  std::vector<double> found;
  std::vector<Eigen::Matrix3d> homographies;
  for (const ResectionView& view : views) {
    Eigen::Matrix3d axes;
    const double thickness = PrincipalExtents(view.points_mm, &axes)[2];
    if (thickness > 0.02 && view.points_mm.rows() >= 6) {
      try {
        const DltResult dlt = DirectLinearTransform(view.points_mm, view.pixels);
        const double f = std::sqrt(dlt.calibration(0, 0) * dlt.calibration(1, 1));
        if (f > 0.2 * side && f < 100 * side) found.push_back(f);
      } catch (const AdjustmentError&) {
        // A start value among others: the grid does without it.
      }
    } else if (thickness < 0.002 && view.points_mm.rows() >= 4) {
      const Points2d plane = view.points_mm * axes.leftCols<2>();
      const auto h = FitHomography(plane, IdealPoints(camera, view.pixels));
      if (h) homographies.push_back(*h);
    }
  }
  const auto f = FocalFromHomographies(homographies);
  if (f && *f > 0.2 * side && *f < 100 * side) found.push_back(*f);
  // The middle one first: it is most likely to be right.
  std::sort(found.begin(), found.end());
  if (!found.empty()) std::swap(found.front(), found[found.size() / 2]);
  return found;
}

std::vector<double> Grid(const Camera& camera) {
  const double side = std::max(camera.width_px, camera.height_px);
  std::vector<double> grid;
  for (double ratio = 0.4; ratio < 41.0; ratio *= 1.6) grid.push_back(ratio * side);
  return grid;
}

Trial GoldenSection(const Camera& camera, const std::vector<ResectionView>& views, Trial best,
                    double threshold_px) {
  constexpr double kGolden = 0.6180339887498949;
  double low = std::log(best.f_px / 1.7), high = std::log(best.f_px * 1.7);
  auto at = [&](double log_f) {
    Trial trial = Follow(camera, views, best, std::exp(log_f), threshold_px);
    if (trial.cost_px2 < best.cost_px2) best = trial;
    return trial.cost_px2;
  };
  double a = high - kGolden * (high - low), b = low + kGolden * (high - low);
  double cost_a = at(a), cost_b = at(b);
  // The bundle that follows needs no better start than half a per cent.
  while (high - low > 0.005) {
    if (cost_a < cost_b) {
      high = b;
      b = a;
      cost_b = cost_a;
      a = high - kGolden * (high - low);
      cost_a = at(a);
    } else {
      low = a;
      a = b;
      cost_a = cost_b;
      b = low + kGolden * (high - low);
      cost_b = at(b);
    }
  }
  return best;
}

}  // namespace

FocalSearchResult SearchFocal(const Camera& camera, const std::vector<ResectionView>& views,
                              double threshold_px) {
  // What fits this well needs no further search.
  const double good = kGoodShare * kGoodShare * threshold_px * threshold_px;
  Trial best;
  const auto try_all = [&](const std::vector<double>& focal_lengths) {
    for (const double f : focal_lengths) {
      if (best.cost_px2 < good) return;
      Trial trial = ResectAll(camera, views, f, threshold_px);
      if (trial.cost_px2 < best.cost_px2) best = std::move(trial);
    }
  };
  try_all(DirectSolutions(camera, views));
  try_all(Grid(camera));
  if (std::none_of(best.has_pose.begin(), best.has_pose.end(), [](bool has) { return has; })) {
    throw AdjustmentError("no pose of any picture fits its points at any principal distance");
  }
  best = GoldenSection(camera, views, std::move(best), threshold_px);
  const double half = Follow(camera, views, best, 0.5 * best.f_px, threshold_px).cost_px2;
  const double twice = Follow(camera, views, best, 2.0 * best.f_px, threshold_px).cost_px2;
  FocalSearchResult result;
  result.f_px = best.f_px;
  result.rms_px = std::sqrt(best.cost_px2);
  result.contrast = std::min(half, twice) / std::max(best.cost_px2, 1e-12);
  return result;
}

}  // namespace videogrammetry
