#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "videogrammetry/geometry/conic.h"
#include "videogrammetry/recognition/signed_image.h"

namespace videogrammetry {

enum class ContourEnd {
  kClosed,       ///< came back to its start
  kExceeds,      ///< exceeds the limits: too large, or ragged
  kLeavesImage,  ///< touches the picture's border
};

/// Area moments of a region of pixels.
struct ContourMoments {
  int width_px = 0, height_px = 0;  ///< of the bounding box
  double area = 0.0;
  double mean_x = 0.0, mean_y = 0.0;
  double var_xx = 0.0, var_xy = 0.0, var_yy = 0.0;  ///< of pixel centres
};

/// A pixel whose left side belongs to a contour.
struct LeftSide {
  int x = 0, y = 0;
};

/// Walks around regions of pixels; keeps its memory from one to the next.
template <typename T>
class ContourFollower {
 public:
  /// @param max_extent_px  a region wider or higher than this is given up.
  ContourFollower(const SignedImage<T>& image, int max_extent_px);

  /// Walks around the 4-connected region of grey values >= level that holds the
  /// pixel (x, y), whose left neighbour lies outside the region.
  ///
  /// The walk follows the sides between pixels with the region on the right
  /// hand, first up along the left side of (x, y). A convex region has as many
  /// sides as its bounding box, at each moment of the walk: one with 5/4 as many
  /// is given up too.
  ContourEnd Follow(int x, int y, int level);

  /// Moments of the region last walked around, by Green's theorem over the
  /// vertical sides; valid after kClosed.
  ContourMoments Moments() const;

  /// Calls visit(LeftSide) for every left side of the last walk, also of one that ended early.
  template <typename Visit>
  void ForEachLeftSide(Visit&& visit) const {
    for (std::ptrdiff_t i = 0; i < count_; ++i) {
      const Side& side = sides_[static_cast<std::size_t>(i)];
      if (side.direction == 0) visit(LeftSide{base_x_ + side.u, base_y_ + side.v});
    }
  }

 private:
  /// A side walked, by the corner reached, from the start's lower left corner.
  struct Side {
    std::int16_t u = 0, v = 0;
    std::int16_t direction = 0;  ///< 0 up, 1 right, 2 down, 3 left
  };

  bool Exceeds(std::ptrdiff_t count) const;

  const SignedImage<T>& image_;
  int max_extent_px_;
  std::vector<Side> sides_;
  std::ptrdiff_t count_ = 0;
  int base_x_ = 0, base_y_ = 0;
  int min_u_ = 0, max_u_ = 0, min_v_ = 0, max_v_ = 0;
};

/// The ellipse with the same second moments: semi axes 2 sqrt(eigenvalue).
/// @return nullopt for a region without extent.
std::optional<Ellipse> EllipseFromMoments(const ContourMoments& moments);

/// Area over the area of the ellipse with the same second moments: 1 for an
/// ellipse, 0.955 for any parallelogram, less for all that is ragged or concave.
double EllipseLikeness(const ContourMoments& moments);

/// Whether that is an ellipse's, 1 (0.955 for a square): the pixels' share falls with the
/// area.
inline bool IsLikeEllipse(const ContourMoments& moments) {
  return EllipseLikeness(moments) >= 0.985 - 0.8 / moments.area;
}

}  // namespace videogrammetry
