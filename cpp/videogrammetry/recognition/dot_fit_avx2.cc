// Compiled with AVX2 enabled and without fused operations; reached through dot_fit.cc alone.
#include "videogrammetry/recognition/dot_fit_kernels.inc"

const Kernels& Avx2Kernels() { return kKernels; }

}  // namespace videogrammetry::dot_fit
