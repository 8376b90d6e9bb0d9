#pragma once

// Private to ring_code.cc: what stands in the sectors of a ring.

#include <array>
#include <cstdint>

#include "videogrammetry/recognition/ring_sampling.h"

namespace videogrammetry {

/// Least difference between the darkest bright and the brightest dark sector,
/// in units of the dot's contrast; a flash may halve the light along a ring.
inline constexpr float kMinStep = 0.3f;

using PerSector = std::array<float, kMaxCodeBits>;

/// The ring's sectors: their heights, and bright or dark.
struct RingSectors {
  int n = 0;
  PerSector plateau = {};  ///< freed from what comes from the neighbours
  PerSector height = {};   ///< and from the loss across the ring: the print's
  PerSector light = {};    ///< of a bright sector at its place
  PerSector left = {};
  std::array<bool, kMaxCodeBits> bright = {};
  std::uint32_t bits = 0;
  float step = 0;
};

/// Mean of the circles on the ring at each direction, of those in the picture.
void MeanRing(const RingSamples& samples, RingCircle* ring);

/// Means of each sector's middle half.
void MeanSectors(const RingCircle& circle, int num_bits, PerSector* means);

/// Heights of the sectors, and which are bright.
///
/// @param ring  the circles' mean.
/// @return false unless they are two separate groups, the bright ones evenly lit and ending
///     at the ring's borders, the dark ones dark up to them.
bool MeasureSectors(const RingSamples& samples, const RingCircle& ring, RingSectors* sectors);

/// Whether every sample is as its sector is, on each circle of the ring, but within a
/// quarter of a sector of a change: what is left of a hidden sector shows, and so
/// does a change that stands between two like sectors.
bool IsUniform(const RingSamples& samples, const RingSectors& sectors);

/// Probability that noise or dirt put a sector on the wrong side.
double WrongSectorProbability(const RingSamples& samples, const RingSectors& sectors);

}  // namespace videogrammetry
