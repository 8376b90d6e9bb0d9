#pragma once

#include <Eigen/Core>
#include <array>

#include "videogrammetry/adjustment/network.h"

namespace videogrammetry {

/// An image point's derivatives by the unknowns that are estimated.
struct ImageRow {
  static constexpr int kMaxUnknowns = kNumCameraUnknowns + 6 + 6 + kNumInterfaceUnknowns + 3;
  bool valid = false;  ///< false: the point has no picture
  int size = 0;
  std::array<int, kMaxUnknowns> unknown;
  Eigen::Matrix<double, 2, kMaxUnknowns> design;  ///< first `size` columns
  Eigen::Vector2d pixel;
};
ImageRow LineariseImagePoint(const Network& network, const UnknownIndex& index, int image,
                             int point, const Eigen::Vector2d& velocity_px);
/// The same of an observation, with what its residual is counted from (PredictObservation).
ImageRow LineariseObservation(const Network& network, const UnknownIndex& index,
                              const NetworkObservation& observation);

/// A scale bar's predicted length and its derivatives by the unknowns.
struct BarRow {
  int size = 0;
  std::array<int, 6> unknown;
  Eigen::Matrix<double, 1, 6> design;
  double length_mm = 0.0;
};
BarRow LineariseBar(const Network& network, const UnknownIndex& index, const NetworkScaleBar& bar);

}  // namespace videogrammetry
