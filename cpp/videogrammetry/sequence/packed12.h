#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "videogrammetry/core/cpu.h"

namespace videogrammetry {

/// How two samples of 12 bits stand in three bytes b0 b1 b2.
enum class PackedOrder {
  /// Most significant bit first, as in Photron's .mraw files:
  /// first = b0 << 4 | b1 >> 4, second = (b1 & 15) << 8 | b2.
  kHighFirst,
  /// Least significant bit first, as in GenICam's Mono12p:
  /// first = b0 | (b1 & 15) << 8, second = b1 >> 4 | b2 << 4.
  kLowFirst,
};

/// Bytes that `num_samples` samples of 12 bits take: (3 n + 1) / 2, so that half
/// a byte is left over after an odd number of samples.
constexpr std::size_t Packed12Bytes(std::size_t num_samples) {
  return num_samples + (num_samples + 1) / 2;
}

/// Spreads packed samples of 12 bits to 16 bits, values 0 to 4095.
///
/// @param packed  Packed12Bytes(samples.size()) bytes; must not overlap `samples`.
/// @param set  instruction set to use, no better than the processor's.
/// @throws std::invalid_argument if the sizes do not fit.
void Unpack12(std::span<const std::uint8_t> packed, PackedOrder order,
              std::span<std::uint16_t> samples, InstructionSet set = DetectInstructionSet());

/// Packs samples into 12 bits each; the inverse of Unpack12. Four bits that an
/// odd number of samples leaves over are zero.
///
/// @param samples  values 0 to 4095.
/// @param packed  Packed12Bytes(samples.size()) bytes; must not overlap `samples`.
/// @throws std::invalid_argument if the sizes do not fit or a value is larger;
///     nothing is written then.
void Pack12(std::span<const std::uint16_t> samples, PackedOrder order,
            std::span<std::uint8_t> packed);

}  // namespace videogrammetry
