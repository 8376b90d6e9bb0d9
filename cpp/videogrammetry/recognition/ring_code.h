#pragma once

#include <cstdint>
#include <optional>

#include "videogrammetry/recognition/code_family.h"
#include "videogrammetry/recognition/ring_sampling.h"

namespace videogrammetry {

/// Why a target has no ID; the numbers are those of RING_STATUS in Python.
enum class RingStatus : std::uint8_t {
  kCoded = 0,       ///< the ring agrees unambiguously with one code of the family
  kNoRing = 1,      ///< nothing bright around the dot: an un-coded target
  kRingCut = 2,     ///< the ring leaves the picture
  kUnclear = 3,     ///< grey values of the sectors are not two separate groups
  kEdgesOff = 4,    ///< bright-dark changes do not fall on the sectors' borders
  kNotInTable = 5,  ///< a clear code that the family does not have
  kMirrored = 6,    ///< a code only when read in the other direction
  kDuplicate = 7,   ///< the same ID stands at several places of the picture
};

/// What was read around a dot.
struct RingReading {
  RingStatus status = RingStatus::kNoRing;
  std::optional<int> id;
  /// How well the ring agrees: least distance of a sector from the half-way
  /// level, 0 ... 0.5, less the largest distance of a change from its border
  /// in sectors. Meaningful for kCoded alone.
  double quality = 0.0;
};

/// Reads the code of sampled rings: step 6 of the local Canny.
///
/// - The gap between dot and ring is dark all around.
/// - The changes between bright and dark along the ring give the phase of the
///   sectors' borders by least squares on the circle.
/// - The sectors' grey values are two separate groups; bright ones end before
///   the gap and beyond the ring, dark ones are dark up to both. Light may
///   change evenly across the target.
/// - Each change, at the level half-way between its two sectors, lies within a
///   quarter of a sector of its border, near the ring's inner and outer border
///   too (a third: fewer pixels).
/// - The code is in the family's table.
/// A minimum cyclic distance of 2 means that one wrong sector is detected,
/// never corrected: nothing is guessed.
RingReading ReadRing(const RingSamples& samples, const CodeFamily& family,
                     ReadingDirection direction);

/// Samples and reads; kNoRing and kRingCut are found on the way.
template <typename T>
RingReading ReadRing(const SignedImage<T>& image, const TargetEdge& dot, const CodeFamily& family,
                     ReadingDirection direction);

}  // namespace videogrammetry
