#include "videogrammetry/recognition/grey_window_kernels.inc"

namespace {

void Sample(const float* data, std::ptrdiff_t stride, const float* x, const float* y, int count,
            float* out) {
  ScalarSample(data, stride, x, y, 0, count, out);
}

constexpr Kernels kKernels = {Row8, Row16, Row12, Sample};

}  // namespace

const Kernels& BaselineKernels() { return kKernels; }

}  // namespace videogrammetry::grey_window
