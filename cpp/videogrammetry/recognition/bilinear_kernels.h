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

/// A sample of a row of packed ones.
static inline float Packed12At(const std::uint8_t* row, bool high_first, int i) {
  const std::uint8_t* b = row + i / 2 * 3;
  if (high_first) {
    return static_cast<float>(i % 2 == 0 ? (b[0] << 4) | (b[1] >> 4) : ((b[1] & 15) << 8) | b[2]);
  }
  return static_cast<float>(i % 2 == 0 ? b[0] | ((b[1] & 15) << 8) : (b[1] >> 4) | (b[2] << 4));
}

static inline void ScalarPacked12(const std::uint8_t* rows, std::ptrdiff_t stride, bool high_first,
                                  int left, const float* x, const float* y, int begin, int end,
                                  float* out) {
  for (int k = begin; k < end; ++k) {
    const int i = static_cast<int>(x[k]), j = static_cast<int>(y[k]);
    const float a = x[k] - static_cast<float>(i), b = y[k] - static_cast<float>(j);
    const std::uint8_t* upper = rows + j * stride;
    const std::uint8_t* lower = upper + stride;
    const float upper_left = Packed12At(upper, high_first, left + i);
    const float upper_right = Packed12At(upper, high_first, left + i + 1);
    const float lower_left = Packed12At(lower, high_first, left + i);
    const float lower_right = Packed12At(lower, high_first, left + i + 1);
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

void BaselinePacked12(const std::uint8_t* rows, std::ptrdiff_t stride, bool high_first, int left,
                      const float* x, const float* y, int count, float* out);
void Avx2Packed12(const std::uint8_t* rows, std::ptrdiff_t stride, bool high_first, int left,
                  const float* x, const float* y, int count, float* out);
void Avx512Packed12(const std::uint8_t* rows, std::ptrdiff_t stride, bool high_first, int left,
                    const float* x, const float* y, int count, float* out);

}  // namespace videogrammetry::bilinear
