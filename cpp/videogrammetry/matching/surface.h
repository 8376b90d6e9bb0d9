#pragma once

#include <span>
#include <vector>

#include "videogrammetry/matching/candidates.h"

namespace videogrammetry {

/// A point taken for granted: where each camera sees it and how far it lies.
struct ReliablePoint {
  std::vector<int> target;  // one a camera: index or -1
  Eigen::Vector3d position_mm;
  Eigen::Matrix3d cov_mm2;
};

/// Sets every candidate's surface_score: the evidence of the surface that its
/// reliable neighbours span.
///
/// In a camera's picture of a plane, the inverse depth is an affine function
/// of the picture coordinates, so the nearest reliable points predict that of
/// a candidate. With the deviation d from the prediction and its standard
/// deviation s (scatter of the neighbours, leverage and noise), the evidence is
///   log((1 - e) N(d; s) R + e),
/// R the range of inverse depth along the ray in the box of all points, e the share of
/// points that lie on no surface: it is bounded below, so a point off the surface with
/// good rays is not lost. e is estimated from the reliable points, each predicted by the
/// others, and where they span no surface (e > 0.8) nothing is added.
///
/// @return whether they span one.
bool SetSurfaceScores(const std::vector<CameraView>& cameras, std::span<const CameraTargets> data,
                      const StageStatistics& statistics, const std::vector<ReliablePoint>& reliable,
                      int neighbours, std::vector<Candidate>* candidates);

}  // namespace videogrammetry
