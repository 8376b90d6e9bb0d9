#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "videogrammetry/recognition/ellipse_fit.h"
#include "videogrammetry/recognition/signed_image.h"

namespace videogrammetry {

/// Distance between the samples of a profile, and their number to each side at
/// most: 16 in all, one register of the widest kernel.
inline constexpr float kProfileStepPx = 0.5f;
inline constexpr int kProfileInward = 8;
inline constexpr int kProfileOutward = 7;

/// Grey values across a closed edge, along the normals of an ellipse.
struct EdgeProfiles {
  std::vector<Eigen::Vector2d> u;  ///< place on the ellipse, see EllipseFrame
  std::vector<float> weight;       ///< length of contour that a profile stands for, mean 1
  double perimeter_px = 0.0;
  double semi_minor_px = 0.0;
  int inward = 0;   ///< samples on the inner side
  int outward = 0;  ///< samples on the outer side
  /// (profiles, inward + 1 + outward): grey value at (k - inward) steps outward.
  Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> grey;

  int count() const { return static_cast<int>(u.size()); }
  int samples() const { return inward + 1 + outward; }
};

/// Samples the profiles of an ellipse, about one a pixel of its contour.
template <typename T>
EdgeProfiles SampleProfiles(const SignedImage<T>& image, const EllipseFrame& ellipse);

/// Where the edge begins and ends, and how high it is at each profile.
struct EdgeLevels {
  int inner = 0, outer = 0;  ///< columns of the plateaus on both sides
  double width_px = 0.0;     ///< standard deviation of the edge's spread
  Eigen::ArrayXf inside;     ///< grey values of both plateaus at each profile,
  Eigen::ArrayXf outside;    ///< smooth along the contour
  /// Variances of the half-way level: of either coefficient of its first
  /// harmonic, and of its mean.
  double gradient_variance = 0.0, mean_variance = 0.0;
  /// First harmonic of the outer plateau beyond its noise, in units of the contrast.
  double uneven_outside = 0.0;
  double inside_glare = 0.0, outside_glare = 0.0;  ///< first harmonics that are added light, or 0
  Eigen::ArrayXf mean_fall;  ///< fall of the mean profile from column k - 1 to k + 1, over 2
};

/// Reads the levels off the mean of all profiles.
///
/// The mean profile's fall is followed from its steepest place to both sides
/// until it has gone to 5 % or turns: those columns are the plateaus, also
/// where a dark rim is only two pixels wide. A plateau's grey values are
/// replaced by their mean and first harmonic along the contour (illumination,
/// held towards none by a prior), so that the noise of single samples does not
/// move the half-way level.
/// @return nullopt if the mean profile does not fall within a pixel of the ellipse.
std::optional<EdgeLevels> MeasureLevels(const EdgeProfiles& profiles);

/// Where the edge lies at each profile.
struct EdgeOffsets {
  Eigen::ArrayXd distance_px;  ///< from the ellipse, outward positive
  /// Variances that the noise of the plateaus adds to either coordinate of the
  /// centre and, common to both, to the semi axes: an error of the half-way
  /// level moves or widens the whole ellipse, so the residuals do not show it.
  double shift_variance_px2 = 0.0, size_variance_px2 = 0.0;
};

/// The mean-gradient method around a known contour: with g(d) the mean
/// gradient's shape and h the half-way level, the edge lies where the mean of
/// the grey values, weighted with g, equals h. To first order that is
/// sum g (I - h) / (C sum g f), f the mean profile's fall per step of height 1
/// and C the contrast. g = f is the weight of least variance for white noise
/// and known levels; it is taken narrower, for an error of h counts by
/// sum g / sum g f.
EdgeOffsets MeasureOffsets(const EdgeProfiles& profiles, const EdgeLevels& levels);

}  // namespace videogrammetry
