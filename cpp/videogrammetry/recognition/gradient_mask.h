#pragma once

#include <cstdint>

#include "videogrammetry/core/cpu.h"

namespace videogrammetry {

/// Binarises one row on its horizontal grey-level gradient, keeping the sign.
///
/// With g(x) = I(x+1) - I(x-1), bit x % 64 of rises[x / 64] is set where
/// g(x) > threshold, that of falls[x / 64] where g(x) < -threshold. The first
/// and the last pixel and the bits beyond the row are 0. Both masks hold
/// (width + 63) / 64 words. Every instruction set gives the same bits.
///
/// @param threshold  0 ... the largest value of the type.
template <typename T>
using GradientMaskRow = void (*)(const T* row, int width, int threshold, std::uint64_t* rises,
                                 std::uint64_t* falls);

/// The fastest kernel of a set (or of the nearest lower one that was built).
template <typename T>
GradientMaskRow<T> SelectGradientMask(InstructionSet set);

}  // namespace videogrammetry
