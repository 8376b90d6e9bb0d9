#pragma once

#include <array>

#include "videogrammetry/recognition/code_family.h"

namespace videogrammetry {

/// The changes of a ring between bright and dark: where, how far from the
/// family's borders, how well known.
struct RingChanges {
  int count = 0;
  std::array<int, kMaxCodeBits> border = {};   ///< a change lies before this sector
  std::array<float, kMaxCodeBits> shift = {};  ///< from its border, in sectors
  std::array<float, kMaxCodeBits> sigma = {};  ///< standard deviation of `shift`
};

/// Takes the weighted mean out of the shifts: where the first sector begins.
/// @return it, in sectors.
double RemovePhase(RingChanges* changes);

/// Probability that the changes are those of another print than the family's,
/// odds / (1 + odds) with the odds against each of these, summed:
///
/// - a ring without order, prior 1 %, its borders anywhere: with the shifts d and
///   their standard deviations s, prod(sqrt(2 pi) s exp(d^2 / 2 s^2)), one factor
///   less for the phase;
/// - a ring of the family of which something hides a part, prior 0.15 %: the same
///   product over the two most distant changes;
/// - a ring of m = 4 ... 24 sectors, prior 1 % over all m: exp((chi2 - chi2_m) / 2),
///   and 2^(num_bits - m) for m > num_bits, since a finer grid fits more. Multiples
///   and divisors of num_bits are left out, and grids on which the changes stand
///   alike: such prints may be the same.
///
/// The priors are a choice, not a measurement: the value ranks IDs and bounds what
/// chance can do; it knows nothing of what no picture shows (a wrong sticker).
double ForeignProbability(const RingChanges& changes, int num_bits);

/// Probability that a sector of these heights (0 dark, 1 bright, half-way 0.5)
/// is on the wrong side: sum of Q(|height - 0.5| / sigma).
double WrongSectorProbability(const float* heights, const float* sigmas, int num_bits);

}  // namespace videogrammetry
