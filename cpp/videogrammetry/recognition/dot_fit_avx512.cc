// Compiled with AVX-512 F, BW, VL and DQ enabled and without fused operations; reached
// through dot_fit.cc alone.
#include "videogrammetry/recognition/dot_fit_kernels.inc"

const Kernels& Avx512Kernels() { return kKernels; }

}  // namespace videogrammetry::dot_fit
