#include "videogrammetry/recognition/dot_fit_kernels.inc"

const Kernels& BaselineKernels() { return kKernels; }

}  // namespace videogrammetry::dot_fit
