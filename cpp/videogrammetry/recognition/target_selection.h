#pragma once

#include <Eigen/Core>
#include <vector>

#include "videogrammetry/recognition/code_family.h"
#include "videogrammetry/recognition/place_index.h"
#include "videogrammetry/recognition/target.h"

namespace videogrammetry {

/// True for a dot that is where one of `known` is: found again at another grey level.
/// @param index  the centres of `known`, by number.
bool IsKnown(const Ellipse& dot, const std::vector<Target>& known, const PlaceIndex& index);

/// Where rings are: whether a dot lies in one and is smaller than the ring's own dot.
class RingPlaces {
 public:
  RingPlaces(const CodeFamily& family, int width, int height);  ///< of the picture

  void Add(const Target& target);  ///< if it has a ring
  /// @param semi_minor_px  of the dot that may be a piece of a ring.
  bool Holds(const Eigen::Vector2d& center_px, double semi_minor_px) const;

 private:
  struct Owner {
    Eigen::Vector2d center;
    Eigen::Matrix2d inverse;  ///< of E
    double semi_minor_px;
  };

  double most_;  ///< in radii of the owner's dot
  double reach_px_ = 0.0;
  std::vector<Owner> owners_;
  PlaceIndex index_;
};

/// Leaves out what lies in another target's ring and is smaller than its dot.
void RemoveRingPieces(const CodeFamily& family, int width, int height,
                      std::vector<Target>* targets);

/// An ID that stands at several places of one picture: a reading clearly worse
/// than the best is taken for wrong; equally clear rings keep the ID that they
/// show, marked, because which of two stickers is meant is not for one picture
/// to say.
void ResolveDuplicates(std::vector<Target>* targets);

}  // namespace videogrammetry
