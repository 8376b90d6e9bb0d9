#pragma once

#include <Eigen/Core>
#include <vector>

#include "videogrammetry/recognition/local_canny.h"

namespace videogrammetry {

using Points2d = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;

/// Corrects edge pixels to sub-pixel edges by the mean-gradient method: step 4
/// of the local Canny.
///
/// Along each pixel's gradient the grey values I(d) are interpolated
/// bilinearly (paper Eq. 9) at d = -2 ... 2 px in steps of 1/2; the edge lies
/// at the mean of d weighted with the fall of the grey value,
/// sum d_k (I_k - I_k+1) / sum (I_k - I_k+1), over the falling stretch around
/// the steepest place within one pixel.
///
/// @return (N, 2), N <= edges.size(): x, y in pixels; a pixel without a fall
///         along its gradient, or one within 1.5 px of the
///         picture's border, is left out.
template <typename T>
Points2d MeanGradientPoints(const SignedImage<T>& image, const std::vector<EdgePixel>& edges);

}  // namespace videogrammetry
