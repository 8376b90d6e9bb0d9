// Compiled with AVX2 enabled and without fused operations; reached through SelectBilinear alone.
#include <immintrin.h>

#include "videogrammetry/recognition/bilinear_kernels.h"

namespace videogrammetry::bilinear {
namespace {

// Two neighbouring samples of a row come with one four-byte load.
template <typename T>
struct Pair;

template <>
struct Pair<std::uint8_t> {
  static __m256i Gather(const std::uint8_t* p, __m256i offset) {
    return _mm256_i32gather_epi32(reinterpret_cast<const int*>(p), offset, 1);
  }
  static __m256 Left(__m256i v) {
    return _mm256_cvtepi32_ps(_mm256_and_si256(v, _mm256_set1_epi32(0xff)));
  }
  static __m256 Right(__m256i v) {
    return _mm256_cvtepi32_ps(_mm256_and_si256(_mm256_srli_epi32(v, 8), _mm256_set1_epi32(0xff)));
  }
};

template <>
struct Pair<std::uint16_t> {
  static __m256i Gather(const std::uint16_t* p, __m256i offset) {
    return _mm256_i32gather_epi32(reinterpret_cast<const int*>(p), offset, 2);
  }
  static __m256 Left(__m256i v) {
    return _mm256_cvtepi32_ps(_mm256_and_si256(v, _mm256_set1_epi32(0xffff)));
  }
  static __m256 Right(__m256i v) { return _mm256_cvtepi32_ps(_mm256_srli_epi32(v, 16)); }
};

template <typename T>
inline __m256 AcrossRow(const T* row, __m256i offset, __m256 a) {
  const __m256i pair = Pair<T>::Gather(row, offset);
  const __m256 left = Pair<T>::Left(pair);
  return _mm256_add_ps(left, _mm256_mul_ps(a, _mm256_sub_ps(Pair<T>::Right(pair), left)));
}

template <typename T>
inline void Samples(const T* image, std::ptrdiff_t stride, const float* x, const float* y,
                    int count, float* out) {
  const __m256i row = _mm256_set1_epi32(static_cast<int>(stride));
  int k = 0;
  for (; k + 8 <= count; k += 8) {
    const __m256 px = _mm256_loadu_ps(x + k), py = _mm256_loadu_ps(y + k);
    const __m256i i = _mm256_cvttps_epi32(px), j = _mm256_cvttps_epi32(py);
    const __m256 a = _mm256_sub_ps(px, _mm256_cvtepi32_ps(i));
    const __m256 b = _mm256_sub_ps(py, _mm256_cvtepi32_ps(j));
    const __m256i offset = _mm256_add_epi32(_mm256_mullo_epi32(j, row), i);
    const __m256 top = AcrossRow(image, offset, a);
    const __m256 bottom = AcrossRow(image + stride, offset, a);
    _mm256_storeu_ps(out + k, _mm256_add_ps(top, _mm256_mul_ps(b, _mm256_sub_ps(bottom, top))));
  }
  ScalarSamples(image, stride, x, y, k, count, out);
}

}  // namespace

void Avx2Samples8(const std::uint8_t* image, std::ptrdiff_t stride, const float* x, const float* y,
                  int count, float* out) {
  Samples(image, stride, x, y, count, out);
}

void Avx2Samples16(const std::uint16_t* image, std::ptrdiff_t stride, const float* x,
                   const float* y, int count, float* out) {
  Samples(image, stride, x, y, count, out);
}

}  // namespace videogrammetry::bilinear
