#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "videogrammetry/recognition/grey_window.h"
#include "videogrammetry/recognition/target_edge.h"

namespace videogrammetry {

/// An ellipse through the tangents that a dot's grey-value gradients give.
struct DualConicFit {
  /// Where the edge falls steepest, free of the blur's and the pixels' spread.
  Ellipse ellipse;
  /// Of (x, y, semi-major, semi-minor, angle), px and rad.
  Eigen::Matrix<double, 5, 5> cov = Eigen::Matrix<double, 5, 5>::Zero();
  /// Standard deviation of the tangents' distances from the ellipse.
  double spread_px = 0.0;
};

/// Fits an ellipse to the gradients around a dot's contour, without edge points.
///
/// A pixel p with the gradient g (central differences) gives the line through p
/// that is normal to g. With the unit normal n and d = n . p a line touches the
/// ellipse of centre c and shape S = E E^T (EllipseFrame) if [1]
///
///     d^2 = n^T (S - c c^T) n + 2 d n . c,                              (1)
///
/// linear in the five entries of the dual conic. Least squares over the pixels of
/// a band about the start's contour, each weighing with the square of its
/// gradient, in coordinates that make the start a unit circle, where equal
/// distances in the picture count alike.
///
/// The tangents of an edge that is blurred lie about it with the variance v of
/// the weights: S comes out as E E^T + v. v is that of the residuals of Eq. (1),
/// and taken off, so that the axes are those of the edge (the blurred picture of a
/// disc, too, falls steepest at its radius, to the order of blur^4 / radius^3).
/// Gradients that are noise have their tangents within the dot: at a contrast of 32 / 13
/// times the noise axes of 4 to 10 px come out 0.02 / 0.09 px too small, centres unharmed.
///
/// The covariance is the noise of the grey values carried through Eq. (1): every
/// pixel's grey value enters the gradients of its four neighbours, so that these
/// correlations are in it; the noise is that of the grey values about a plane on
/// the plateaus inside and outside, linear in between. What central differences
/// of a sharp edge leave in the centre without noise is added.
///
/// @param window  the start's contour and 5 px around, or less at a picture's border.
/// @return nullopt if the gradients determine no ellipse near the start.
///
/// [1] J.-N. Ouellet, P. Hebert, Precise ellipse estimation without contour
///     point extraction, Machine Vision and Applications 21 (2009) 59-67.
std::optional<DualConicFit> FitDualConic(const GreyWindow& window, const TargetEdge& start);

/// Measures dots anew by FitDualConic. A dot that cannot be fitted stays as it was.
///
/// @param sign  +1: dots are bright, -1: dark.
void RefineByDualConic(const FrameView& frame, int sign, const std::vector<TargetEdge*>& edges);

}  // namespace videogrammetry
