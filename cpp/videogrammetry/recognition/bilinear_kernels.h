#pragma once

// Private to the bilinear interpolation: the same kernel for each instruction
// set. The files that define them are compiled with flags of their own, so
// nothing that is inlined elsewhere may be defined or instantiated in them.

#include <cstddef>
#include <cstdint>

namespace videogrammetry::bilinear {

template <typename T>
static inline void ScalarSamples(const T* image, std::ptrdiff_t stride, const float* x,
                                 const float* y, int begin, int end, float* out) {
  for (int k = begin; k < end; ++k) {
    const int i = static_cast<int>(x[k]), j = static_cast<int>(y[k]);
    const float a = x[k] - static_cast<float>(i), b = y[k] - static_cast<float>(j);
    const T* upper = image + j * stride + i;
    const T* lower = upper + stride;
    const float upper_left = upper[0], upper_right = upper[1];
    const float lower_left = lower[0], lower_right = lower[1];
    const float top = upper_left + a * (upper_right - upper_left);
    const float bottom = lower_left + a * (lower_right - lower_left);
    out[k] = top + b * (bottom - top);
  }
}

void Baseline8(const std::uint8_t* image, std::ptrdiff_t stride, const float* x, const float* y,
               int count, float* out);
void Baseline16(const std::uint16_t* image, std::ptrdiff_t stride, const float* x, const float* y,
                int count, float* out);
void Avx2Samples8(const std::uint8_t* image, std::ptrdiff_t stride, const float* x, const float* y,
                  int count, float* out);
void Avx2Samples16(const std::uint16_t* image, std::ptrdiff_t stride, const float* x,
                   const float* y, int count, float* out);
void Avx512Samples8(const std::uint8_t* image, std::ptrdiff_t stride, const float* x,
                    const float* y, int count, float* out);
void Avx512Samples16(const std::uint16_t* image, std::ptrdiff_t stride, const float* x,
                     const float* y, int count, float* out);

}  // namespace videogrammetry::bilinear
