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
  /// How well the ring agrees: half the step between dark and bright sectors (at
  /// most 0.5), less the largest distance of a change from its border in sectors.
  /// Meaningful where there is an ID.
  double quality = 0.0;
  /// Probability that the ID is right, in the sense of ring_confidence.h: 0.999 or
  /// more where there is an ID, 0 elsewhere.
  double confidence = 0.0;
  /// Where there is an ID, how the ring lies: bit n - 1 - k says whether sector k is bright,
  /// and sector 0 begins this many sectors clockwise of the direction of x (RingSampler's u).
  std::uint32_t bits = 0;
  double phase_sectors = 0.0;
};

/// Reads the code of sampled rings: step 6 of the local Canny.
///
/// - The sectors' grey values, freed from what the blur brings over from their
///   neighbours and takes across the ring's borders, are two separate groups.
///   Bright ones end before the gap and beyond the ring, dark ones are dark up to
///   both. Light may change evenly across the target.
/// - Each change, at the level half-way between its two sectors, falls on a
///   sector's border, near the ring's inner and outer border too, as nearly as
///   the dot's own edge was found: ring_confidence.h weighs it against rings of
///   other families and rings that something covers in part.
/// - The code is in the family's table.
/// A minimum cyclic distance of 2 means that one wrong sector is detected,
/// never corrected: nothing is guessed, and a ring that is covered in part has no ID.
///
/// `phase_sectors` of the reading counts from the samples' first.
RingReading ReadRing(const RingSamples& samples, const CodeFamily& family,
                     ReadingDirection direction);

/// Samples and reads. kNoRing is found by a first look at four samples a sector:
/// fewer than two of them in the ring's middle are brighter than 0.3 of the dot's
/// contrast (a bright sector that can be read holds three or four such), or the gap
/// between dot and ring is bright in more than one direction of thirty. kRingCut:
/// the picture ends before the ring's inner part does.
RingReading ReadRing(const GreySampler& picture, const TargetEdge& dot, const CodeFamily& family,
                     ReadingDirection direction);

/// Reads a ring whose code is known from the picture before, by four samples a sector in
/// its middle: a ninth of what ReadRing looks at.
///
/// It is the same ring, with the ID, quality and confidence that it was read with, if every
/// sector is bright or dark as it was (beyond 0.7 and below 0.35 of the bright ones' mean) and all
/// changes have moved alike, by no more than a fifth of a sector: the target may turn.
///
/// @return nullopt if it is not, or was not kCoded: ReadRing has to say what it is.
std::optional<RingReading> FollowRing(const GreySampler& picture, const TargetEdge& dot,
                                      const CodeFamily& family, const RingReading& before);

}  // namespace videogrammetry
