#pragma once

#include <cstddef>
#include <cstdint>

#include "videogrammetry/sequence/packed12.h"

namespace videogrammetry::packed12 {

#ifdef VIDEOGRAMMETRY_X86_KERNELS
/// Unpacks as many of the `num_samples` as go in whole vectors without reading
/// past the `num_bytes` at `packed`; returns how many, a multiple of 16.
std::size_t Avx2Unpack(const std::uint8_t* packed, std::size_t num_bytes, PackedOrder order,
                       std::uint16_t* samples, std::size_t num_samples);
#endif

}  // namespace videogrammetry::packed12
