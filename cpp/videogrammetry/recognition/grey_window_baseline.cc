#include "videogrammetry/recognition/grey_window_kernels.inc"

const Kernels& BaselineKernels() { return kKernels; }

}  // namespace videogrammetry::grey_window
