#pragma once

#include <cstddef>
#include <cstdint>

#include "videogrammetry/core/cpu.h"

namespace videogrammetry {

/// Grey values between pixels at many places, paper Eq. (9).
///
/// out[k] = I(x[k], y[k]) interpolated bilinearly in float arithmetic without
/// fused operations, so that every instruction set gives the same bits. For
/// each place 0 <= x, 0 <= y, and `kBilinearMargin` pixels to the right of and
/// one below (floor x, floor y) must be readable; row * stride must fit 2^30.
///
/// @param stride  samples from one row's start to the next's.
template <typename T>
using BilinearKernel = void (*)(const T* image, std::ptrdiff_t stride, const float* x,
                                const float* y, int count, float* out);

/// Pixels read to the right of the one at floor x: kernels load four bytes at once.
inline constexpr int kBilinearMargin = 3;

/// The fastest kernel of a set (or of the nearest lower one that was built).
template <typename T>
BilinearKernel<T> SelectBilinear(InstructionSet set);

/// The same in packed samples of 12 bits at the places (left + x[k], y[k]): `rows` is the
/// first byte of a row.
using BilinearPacked12Kernel = void (*)(const std::uint8_t* rows, std::ptrdiff_t stride_bytes,
                                        bool high_first, int left, const float* x, const float* y,
                                        int count, float* out);
BilinearPacked12Kernel SelectBilinearPacked12(InstructionSet set);

}  // namespace videogrammetry
