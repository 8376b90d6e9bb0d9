// Compiled with AVX-512 F, BW, VL and DQ enabled and without fused operations; reached
// through grey_window.cc alone.
#include <immintrin.h>

#include "videogrammetry/recognition/grey_window_kernels.inc"

namespace {

// Two neighbours of a row come with one gathered double.
struct Pair {
  __m512 left, right;
};

inline Pair Gather(const float* row, __m512i at) {
  const __m512i even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
  const __m512i odd = _mm512_add_epi32(even, _mm512_set1_epi32(1));
  const __m512 low = _mm512_castpd_ps(_mm512_i32gather_pd(_mm512_castsi512_si256(at), row, 4));
  const __m512 high =
      _mm512_castpd_ps(_mm512_i32gather_pd(_mm512_extracti64x4_epi64(at, 1), row, 4));
  return {_mm512_permutex2var_ps(low, even, high), _mm512_permutex2var_ps(low, odd, high)};
}

inline __m512 Between(__m512 from, __m512 to, __m512 part) {
  return _mm512_add_ps(from, _mm512_mul_ps(part, _mm512_sub_ps(to, from)));
}

void Sample(const float* data, std::ptrdiff_t stride, const float* x, const float* y, int count,
            float* out) {
  const __m512i row = _mm512_set1_epi32(static_cast<int>(stride));
  int k = 0;
  for (; k + 16 <= count; k += 16) {
    const __m512 px = _mm512_loadu_ps(x + k), py = _mm512_loadu_ps(y + k);
    const __m512i i = _mm512_cvttps_epi32(px), j = _mm512_cvttps_epi32(py);
    const __m512 a = _mm512_sub_ps(px, _mm512_cvtepi32_ps(i));
    const __m512 b = _mm512_sub_ps(py, _mm512_cvtepi32_ps(j));
    const __m512i at = _mm512_add_epi32(_mm512_mullo_epi32(j, row), i);
    const Pair upper = Gather(data, at), lower = Gather(data + stride, at);
    _mm512_storeu_ps(out + k, Between(Between(upper.left, upper.right, a),
                                      Between(lower.left, lower.right, a), b));
  }
  ScalarSample(data, stride, x, y, k, count, out);
}

constexpr Kernels kKernels = {Row8, Row16, Row12, Sample};

}  // namespace

const Kernels& Avx512Kernels() { return kKernels; }

}  // namespace videogrammetry::grey_window
