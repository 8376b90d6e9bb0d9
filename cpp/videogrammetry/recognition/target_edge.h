#pragma once

#include <Eigen/Core>
#include <optional>

#include "videogrammetry/recognition/candidate_search.h"
#include "videogrammetry/recognition/options.h"

namespace videogrammetry {

/// A dot's edge, measured.
struct TargetEdge {
  Ellipse ellipse;
  /// Covariance of (x, y, semi-major, semi-minor, angle), px and rad.
  Eigen::Matrix<double, 5, 5> cov = Eigen::Matrix<double, 5, 5>::Zero();
  double edge_rms_px = 0.0;  ///< of the edge points' distances from the ellipse
  double inside = 0.0;       ///< mean grey values on both sides, with the polarity's sign
  double outside = 0.0;
  double width_px = 0.0;  ///< standard deviation of the edge's spread
  /// First harmonics of both plateaus that are added light, in grey values, or 0.
  double inside_glare = 0.0, outside_glare = 0.0;
  /// Whether the axes are those of the printed dot (a model with its blur); else the blur
  /// may have made them smaller, to second order in blur over radius.
  bool exact_axes = false;
};

/// Measures a candidate's edge: steps 3 to 5 of the local Canny, and the last word on it.
///
/// 1. Canny's edges near the candidate's ellipse (local_canny.h), corrected to
///    sub-pixel edges by the mean-gradient method (edge_points.h), and a
///    direct fit with outliers left out (ellipse_fit.h). The edges must close
///    around the ellipse.
/// 2. Least squares with orthogonal distances: profiles along the ellipse's own
///    normals, an offset from each (edge_profile.h), and a Gauss-Newton step
///    on the five parameters, repeated; profiles off by more than 3.5 robust
///    standard deviations (and 0.25 px) are left out.
/// 3. A dot has its edge all around, of similar contrast, sharper than the dot
///    is large, with residuals that are noise and not another shape's, and a
///    middle as bright as its rim.
///
/// The covariance is s^2 (J^T W J)^-1 with s^2 from the residuals. Neighbouring
/// profiles share pixels, so only one in `kCorrelationPx` of the contour counts
/// as independent, in s^2's degrees of freedom and in J^T W J.
///
/// @return nullopt if this is no dot.
template <typename T>
std::optional<TargetEdge> MeasureTargetEdge(const SignedImage<T>& image, const Candidate& candidate,
                                            const RecognitionOptions& options);

}  // namespace videogrammetry
