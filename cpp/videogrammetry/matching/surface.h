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

/// Adds to every candidate's geometric score the evidence of the surface that
/// its reliable neighbours span.
///
/// In a camera's picture of a plane, the inverse depth is an affine function
/// of the picture coordinates, so the nearest reliable points predict that of
/// a candidate. With the deviation d from the prediction and its standard
/// deviation s (scatter of the neighbours, leverage and noise), the evidence is
///   log((1 - e) N(d; s) R + e),
/// R the range of inverse depth over all candidates, e the share of points that
/// lie on no surface: it is bounded below, so a point off the surface with good
/// rays is not lost.
void AddSurfaceEvidence(const Rig& rig, std::span<const CameraTargets> cameras,
                        const std::vector<ReliablePoint>& reliable, int neighbours,
                        std::vector<Candidate>* candidates);

}  // namespace videogrammetry
