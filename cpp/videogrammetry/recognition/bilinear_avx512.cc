// Compiled with AVX-512 F, BW, VL and DQ enabled and without fused operations; reached through
// SelectBilinear alone.
#include <immintrin.h>

#include "videogrammetry/recognition/bilinear_kernels.h"

namespace videogrammetry::bilinear {
namespace {

// Two neighbouring samples of a row come with one four-byte load.
template <typename T>
struct Pair;

template <>
struct Pair<std::uint8_t> {
  static __m512i Gather(const std::uint8_t* p, __m512i offset) {
    return _mm512_i32gather_epi32(offset, p, 1);
  }
  static __m512 Left(__m512i v) {
    return _mm512_cvtepi32_ps(_mm512_and_si512(v, _mm512_set1_epi32(0xff)));
  }
  static __m512 Right(__m512i v) {
    return _mm512_cvtepi32_ps(_mm512_and_si512(_mm512_srli_epi32(v, 8), _mm512_set1_epi32(0xff)));
  }
};

template <>
struct Pair<std::uint16_t> {
  static __m512i Gather(const std::uint16_t* p, __m512i offset) {
    return _mm512_i32gather_epi32(offset, p, 2);
  }
  static __m512 Left(__m512i v) {
    return _mm512_cvtepi32_ps(_mm512_and_si512(v, _mm512_set1_epi32(0xffff)));
  }
  static __m512 Right(__m512i v) { return _mm512_cvtepi32_ps(_mm512_srli_epi32(v, 16)); }
};

template <typename T>
inline __m512 AcrossRow(const T* row, __m512i offset, __m512 a) {
  const __m512i pair = Pair<T>::Gather(row, offset);
  const __m512 left = Pair<T>::Left(pair);
  return _mm512_add_ps(left, _mm512_mul_ps(a, _mm512_sub_ps(Pair<T>::Right(pair), left)));
}

template <typename T>
inline void Samples(const T* image, std::ptrdiff_t stride, const float* x, const float* y,
                    int count, float* out) {
  const __m512i row = _mm512_set1_epi32(static_cast<int>(stride));
  int k = 0;
  for (; k + 16 <= count; k += 16) {
    const __m512 px = _mm512_loadu_ps(x + k), py = _mm512_loadu_ps(y + k);
    const __m512i i = _mm512_cvttps_epi32(px), j = _mm512_cvttps_epi32(py);
    const __m512 a = _mm512_sub_ps(px, _mm512_cvtepi32_ps(i));
    const __m512 b = _mm512_sub_ps(py, _mm512_cvtepi32_ps(j));
    const __m512i offset = _mm512_add_epi32(_mm512_mullo_epi32(j, row), i);
    const __m512 top = AcrossRow(image, offset, a);
    const __m512 bottom = AcrossRow(image + stride, offset, a);
    _mm512_storeu_ps(out + k, _mm512_add_ps(top, _mm512_mul_ps(b, _mm512_sub_ps(bottom, top))));
  }
  ScalarSamples(image, stride, x, y, k, count, out);
}

}  // namespace

void Avx512Samples8(const std::uint8_t* image, std::ptrdiff_t stride, const float* x,
                    const float* y, int count, float* out) {
  Samples(image, stride, x, y, count, out);
}

void Avx512Samples16(const std::uint16_t* image, std::ptrdiff_t stride, const float* x,
                     const float* y, int count, float* out) {
  Samples(image, stride, x, y, count, out);
}

}  // namespace videogrammetry::bilinear
