#pragma once

#include <cstdint>
#include <span>

#include "videogrammetry/core/cpu.h"
#include "videogrammetry/core/packed12_view.h"

namespace videogrammetry {

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
