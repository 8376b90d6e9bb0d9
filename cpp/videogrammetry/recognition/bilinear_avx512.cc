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

// Two neighbouring packed samples come with the four bytes from the one in which the first
// begins: shifted to the place of an even first one, by 4 bits where it is odd.
template <bool kHighFirst>
struct PackedPair {
  static __m512i Gather(const std::uint8_t* p, __m512i offset, __m512i shift) {
    const __m512i bytes = _mm512_i32gather_epi32(offset, p, 1);
    if constexpr (kHighFirst) {
      const __m128i in_four = _mm_setr_epi8(3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12);
      const __m512i turn = _mm512_broadcast_i32x4(in_four);
      return _mm512_sllv_epi32(_mm512_shuffle_epi8(bytes, turn), shift);
    } else {
      return _mm512_srlv_epi32(bytes, shift);
    }
  }
  static __m512 Masked(__m512i v) {
    return _mm512_cvtepi32_ps(_mm512_and_si512(v, _mm512_set1_epi32(0xfff)));
  }
  static __m512 Left(__m512i v) { return Masked(kHighFirst ? _mm512_srli_epi32(v, 20) : v); }
  static __m512 Right(__m512i v) { return Masked(_mm512_srli_epi32(v, kHighFirst ? 8 : 12)); }
};

template <bool kHighFirst>
inline __m512 AcrossPackedRow(const std::uint8_t* row, __m512i offset, __m512i shift, __m512 a) {
  using Pair = PackedPair<kHighFirst>;
  const __m512i pair = Pair::Gather(row, offset, shift);
  const __m512 left = Pair::Left(pair);
  return _mm512_add_ps(left, _mm512_mul_ps(a, _mm512_sub_ps(Pair::Right(pair), left)));
}

template <bool kHighFirst>
inline void PackedSamples(const std::uint8_t* rows, std::ptrdiff_t stride, int left, const float* x,
                          const float* y, int count, float* out) {
  const __m512i row = _mm512_set1_epi32(static_cast<int>(stride)), first = _mm512_set1_epi32(left);
  int k = 0;
  for (; k + 16 <= count; k += 16) {
    const __m512 px = _mm512_loadu_ps(x + k), py = _mm512_loadu_ps(y + k);
    const __m512i i = _mm512_cvttps_epi32(px), j = _mm512_cvttps_epi32(py);
    const __m512 a = _mm512_sub_ps(px, _mm512_cvtepi32_ps(i)),
                 b = _mm512_sub_ps(py, _mm512_cvtepi32_ps(j));
    const __m512i at = _mm512_add_epi32(i, first);
    const __m512i byte = _mm512_add_epi32(at, _mm512_srli_epi32(at, 1));
    const __m512i shift = _mm512_slli_epi32(_mm512_and_si512(at, _mm512_set1_epi32(1)), 2);
    const __m512i offset = _mm512_add_epi32(_mm512_mullo_epi32(j, row), byte);
    const __m512 top = AcrossPackedRow<kHighFirst>(rows, offset, shift, a);
    const __m512 bottom = AcrossPackedRow<kHighFirst>(rows + stride, offset, shift, a);
    _mm512_storeu_ps(out + k, _mm512_add_ps(top, _mm512_mul_ps(b, _mm512_sub_ps(bottom, top))));
  }
  ScalarPacked12(rows, stride, kHighFirst, left, x, y, k, count, out);
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

void Avx512Packed12(const std::uint8_t* rows, std::ptrdiff_t stride, bool high_first, int left,
                    const float* x, const float* y, int count, float* out) {
  high_first ? PackedSamples<true>(rows, stride, left, x, y, count, out)
             : PackedSamples<false>(rows, stride, left, x, y, count, out);
}

}  // namespace videogrammetry::bilinear
