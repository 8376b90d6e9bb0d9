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

// Two neighbouring packed samples come with the four bytes from the one in which the first
// begins: shifted to the place of an even first one, by 4 bits where it is odd.
template <bool kHighFirst>
struct PackedPair {
  static __m256i Gather(const std::uint8_t* p, __m256i offset, __m256i shift) {
    const __m256i bytes = _mm256_i32gather_epi32(reinterpret_cast<const int*>(p), offset, 1);
    if constexpr (kHighFirst) {
      const __m128i in_four = _mm_setr_epi8(3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12);
      const __m256i turn = _mm256_broadcastsi128_si256(in_four);
      return _mm256_sllv_epi32(_mm256_shuffle_epi8(bytes, turn), shift);
    } else {
      return _mm256_srlv_epi32(bytes, shift);
    }
  }
  static __m256 Masked(__m256i v) {
    return _mm256_cvtepi32_ps(_mm256_and_si256(v, _mm256_set1_epi32(0xfff)));
  }
  static __m256 Left(__m256i v) { return Masked(kHighFirst ? _mm256_srli_epi32(v, 20) : v); }
  static __m256 Right(__m256i v) { return Masked(_mm256_srli_epi32(v, kHighFirst ? 8 : 12)); }
};

template <bool kHighFirst>
inline __m256 AcrossPackedRow(const std::uint8_t* row, __m256i offset, __m256i shift, __m256 a) {
  using Pair = PackedPair<kHighFirst>;
  const __m256i pair = Pair::Gather(row, offset, shift);
  const __m256 left = Pair::Left(pair);
  return _mm256_add_ps(left, _mm256_mul_ps(a, _mm256_sub_ps(Pair::Right(pair), left)));
}

template <bool kHighFirst>
inline void PackedSamples(const std::uint8_t* rows, std::ptrdiff_t stride, int left, const float* x,
                          const float* y, int count, float* out) {
  const __m256i row = _mm256_set1_epi32(static_cast<int>(stride)), first = _mm256_set1_epi32(left);
  int k = 0;
  for (; k + 8 <= count; k += 8) {
    const __m256 px = _mm256_loadu_ps(x + k), py = _mm256_loadu_ps(y + k);
    const __m256i i = _mm256_cvttps_epi32(px), j = _mm256_cvttps_epi32(py);
    const __m256 a = _mm256_sub_ps(px, _mm256_cvtepi32_ps(i)),
                 b = _mm256_sub_ps(py, _mm256_cvtepi32_ps(j));
    const __m256i at = _mm256_add_epi32(i, first);
    const __m256i byte = _mm256_add_epi32(at, _mm256_srli_epi32(at, 1));
    const __m256i shift = _mm256_slli_epi32(_mm256_and_si256(at, _mm256_set1_epi32(1)), 2);
    const __m256i offset = _mm256_add_epi32(_mm256_mullo_epi32(j, row), byte);
    const __m256 top = AcrossPackedRow<kHighFirst>(rows, offset, shift, a);
    const __m256 bottom = AcrossPackedRow<kHighFirst>(rows + stride, offset, shift, a);
    _mm256_storeu_ps(out + k, _mm256_add_ps(top, _mm256_mul_ps(b, _mm256_sub_ps(bottom, top))));
  }
  ScalarPacked12(rows, stride, kHighFirst, left, x, y, k, count, out);
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

void Avx2Packed12(const std::uint8_t* rows, std::ptrdiff_t stride, bool high_first, int left,
                  const float* x, const float* y, int count, float* out) {
  high_first ? PackedSamples<true>(rows, stride, left, x, y, count, out)
             : PackedSamples<false>(rows, stride, left, x, y, count, out);
}

}  // namespace videogrammetry::bilinear
