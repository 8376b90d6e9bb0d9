// Compiled with AVX2 enabled and without fused operations; reached through
// grey_window.cc alone.
#include <immintrin.h>

#include "videogrammetry/recognition/grey_window_kernels.inc"

namespace {

// Two neighbours of a row come with one gathered double; unpacking them leaves the
// lanes in the order 0 1 4 5 2 3 6 7, in which everything else is put too.
struct Pair {
  __m256 left, right;
};

inline Pair Gather(const float* row, __m256i at) {
  const auto* doubles = reinterpret_cast<const double*>(row);
  const __m256 low = _mm256_castpd_ps(_mm256_i32gather_pd(doubles, _mm256_castsi256_si128(at), 4));
  const __m256 high =
      _mm256_castpd_ps(_mm256_i32gather_pd(doubles, _mm256_extracti128_si256(at, 1), 4));
  return {_mm256_shuffle_ps(low, high, 0x88), _mm256_shuffle_ps(low, high, 0xdd)};
}

inline __m256 InOrderOfPairs(__m256 v) {
  return _mm256_castpd_ps(_mm256_permute4x64_pd(_mm256_castps_pd(v), 0xd8));
}

inline __m256 Between(__m256 from, __m256 to, __m256 part) {
  return _mm256_add_ps(from, _mm256_mul_ps(part, _mm256_sub_ps(to, from)));
}

void Sample(const float* data, std::ptrdiff_t stride, const float* x, const float* y, int count,
            float* out) {
  const __m256i row = _mm256_set1_epi32(static_cast<int>(stride));
  int k = 0;
  for (; k + 8 <= count; k += 8) {
    const __m256 px = _mm256_loadu_ps(x + k), py = _mm256_loadu_ps(y + k);
    const __m256i i = _mm256_cvttps_epi32(px), j = _mm256_cvttps_epi32(py);
    const __m256 a = InOrderOfPairs(_mm256_sub_ps(px, _mm256_cvtepi32_ps(i)));
    const __m256 b = InOrderOfPairs(_mm256_sub_ps(py, _mm256_cvtepi32_ps(j)));
    const __m256i at = _mm256_add_epi32(_mm256_mullo_epi32(j, row), i);
    const Pair upper = Gather(data, at), lower = Gather(data + stride, at);
    const __m256 value =
        Between(Between(upper.left, upper.right, a), Between(lower.left, lower.right, a), b);
    _mm256_storeu_ps(out + k, InOrderOfPairs(value));
  }
  ScalarSample(data, stride, x, y, k, count, out);
}

constexpr Kernels kKernels = {Row8, Row16, Row12, Sample};

}  // namespace

const Kernels& Avx2Kernels() { return kKernels; }

}  // namespace videogrammetry::grey_window
