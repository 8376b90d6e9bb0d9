// Compiled with AVX2 enabled; reached through weighted_rows.cc alone.
#include <immintrin.h>

#include "videogrammetry/reconstruction/weighted_rows.h"

namespace videogrammetry {
namespace {

double Sum(__m256d v) {
  const __m128d pairs = _mm_add_pd(_mm256_castpd256_pd128(v), _mm256_extractf128_pd(v, 1));
  return _mm_cvtsd_f64(_mm_add_sd(pairs, _mm_unpackhi_pd(pairs, pairs)));
}

__m256d AddProduct(__m256d sum, __m256d a, __m256d b) {
  return _mm256_add_pd(sum, _mm256_mul_pd(a, b));
}

}  // namespace

void Avx2WeightedRows(const double* const* rows, const double* weights, int num_rows, int width,
                      double* products) {
  __m256d sums[6];
  for (__m256d& sum : sums) sum = _mm256_setzero_pd();
  for (int begin = 0; begin < width; begin += 8) {
    __m256d w[3][2];
    for (auto& axis : w) axis[0] = axis[1] = _mm256_setzero_pd();
    for (int k = 0; k < num_rows; ++k) {
      const __m256d low = _mm256_loadu_pd(rows[k] + begin);
      const __m256d high = _mm256_loadu_pd(rows[k] + begin + 4);
      for (int axis = 0; axis < 3; ++axis) {
        const __m256d g = _mm256_broadcast_sd(weights + 3 * k + axis);
        w[axis][0] = AddProduct(w[axis][0], g, low);
        w[axis][1] = AddProduct(w[axis][1], g, high);
      }
    }
    int at = 0;
    for (int a = 0; a < 3; ++a) {
      for (int b = a; b < 3; ++b, ++at) {
        sums[at] = AddProduct(AddProduct(sums[at], w[a][0], w[b][0]), w[a][1], w[b][1]);
      }
    }
  }
  for (int i = 0; i < 6; ++i) products[i] = Sum(sums[i]);
}

}  // namespace videogrammetry
