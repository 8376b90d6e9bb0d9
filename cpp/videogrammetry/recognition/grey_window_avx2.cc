// Compiled with AVX2 enabled and without fused operations; reached through
// grey_window.cc alone.
#include <immintrin.h>

#include "videogrammetry/recognition/grey_window_kernels.inc"

const Kernels& Avx2Kernels() { return kKernels; }

}  // namespace videogrammetry::grey_window
