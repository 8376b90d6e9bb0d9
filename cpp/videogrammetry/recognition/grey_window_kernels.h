#pragma once

// Private to grey_window.cc: the same kernels for each instruction set. The files
// that define them are compiled with flags of their own, so nothing that is
// inlined elsewhere may be defined or instantiated in them.

#include <cstddef>
#include <cstdint>

namespace videogrammetry::grey_window {

struct Kernels {
  /// `count` samples times `sign` as floats.
  void (*row8)(const std::uint8_t* samples, int count, float sign, float* out);
  void (*row16)(const std::uint16_t* samples, int count, float sign, float* out);
  /// Packed samples of 12 bits, beginning with an even one.
  void (*row12)(const std::uint8_t* packed, bool high_first, int count, float sign, float* out);
  /// `num_rows` rows of them: kGroup12 samples at a time, `count` and those that fill the last
  /// group up; of each row the kernel loads kBeyond12 bytes more than those groups have.
  void (*rows12)(const std::uint8_t* packed, std::ptrdiff_t stride_bytes, bool high_first,
                 int num_rows, int count, float sign, float* out, std::ptrdiff_t out_stride);
};

inline constexpr int kGroup12 = 16, kBeyond12 = 4;

const Kernels& BaselineKernels();
const Kernels& Avx2Kernels();
const Kernels& Avx512Kernels();

}  // namespace videogrammetry::grey_window
