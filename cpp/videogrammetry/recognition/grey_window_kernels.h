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
};

const Kernels& BaselineKernels();
const Kernels& Avx2Kernels();
const Kernels& Avx512Kernels();

}  // namespace videogrammetry::grey_window
