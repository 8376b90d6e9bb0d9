// Compiled with AVX-512 F, BW, VL and DQ enabled and without fused operations; reached
// through grey_window.cc alone.
#include <immintrin.h>

#include "videogrammetry/recognition/grey_window_kernels.inc"

const Kernels& Avx512Kernels() { return kKernels; }

}  // namespace videogrammetry::grey_window
