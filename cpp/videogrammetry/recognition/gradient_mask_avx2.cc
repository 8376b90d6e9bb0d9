// Compiled with AVX2 enabled; reached through SelectGradientMask alone.
#include <immintrin.h>

#include "videogrammetry/recognition/gradient_mask_kernels.h"

namespace videogrammetry::gradient_mask {
namespace {

// Bits where a - b > threshold, for 32 pixels; `least` holds threshold + 1.
inline std::uint64_t Exceeds8(__m256i a, __m256i b, __m256i least) {
  const __m256i difference = _mm256_subs_epu8(a, b);
  const __m256i hit = _mm256_cmpeq_epi8(_mm256_max_epu8(difference, least), difference);
  return static_cast<std::uint32_t>(_mm256_movemask_epi8(hit));
}

// The same for 16 pixels, as bytes of 0 or 255 in the lower half.
inline __m256i Hits16(__m256i a, __m256i b, __m256i least) {
  const __m256i difference = _mm256_subs_epu16(a, b);
  return _mm256_cmpeq_epi16(_mm256_max_epu16(difference, least), difference);
}

inline std::uint64_t Pack16(__m256i low, __m256i high) {
  const __m256i bytes = _mm256_permute4x64_epi64(_mm256_packs_epi16(low, high), 0xd8);
  return static_cast<std::uint32_t>(_mm256_movemask_epi8(bytes));
}

inline __m256i Load(const void* p) { return _mm256_loadu_si256(static_cast<const __m256i*>(p)); }

}  // namespace

void Avx2Mask8(const std::uint8_t* row, int width, int threshold, std::uint64_t* rises,
               std::uint64_t* falls) {
  const int words = (width + 63) / 64;
  for (int i = 0; i < words; ++i) rises[i] = falls[i] = 0;
  if (threshold >= 255) return;
  const __m256i least = _mm256_set1_epi8(static_cast<char>(threshold + 1));
  ScalarBits(row, 1, width - 1 < 64 ? width - 1 : 64, threshold, rises, falls);
  int x = 64;
  for (; x + 64 < width; x += 64) {
    const __m256i left0 = Load(row + x - 1), right0 = Load(row + x + 1);
    const __m256i left1 = Load(row + x + 31), right1 = Load(row + x + 33);
    rises[x >> 6] = Exceeds8(right0, left0, least) | Exceeds8(right1, left1, least) << 32;
    falls[x >> 6] = Exceeds8(left0, right0, least) | Exceeds8(left1, right1, least) << 32;
  }
  ScalarBits(row, x, width - 1, threshold, rises, falls);
}

void Avx2Mask16(const std::uint16_t* row, int width, int threshold, std::uint64_t* rises,
                std::uint64_t* falls) {
  const int words = (width + 63) / 64;
  for (int i = 0; i < words; ++i) rises[i] = falls[i] = 0;
  if (threshold >= 65535) return;
  const __m256i least = _mm256_set1_epi16(static_cast<short>(threshold + 1));
  ScalarBits(row, 1, width - 1 < 64 ? width - 1 : 64, threshold, rises, falls);
  int x = 64;
  for (; x + 64 < width; x += 64) {
    std::uint64_t rise = 0, fall = 0;
    for (int part = 0; part < 2; ++part) {
      const std::uint16_t* p = row + x + 32 * part;
      const __m256i left0 = Load(p - 1), right0 = Load(p + 1);
      const __m256i left1 = Load(p + 15), right1 = Load(p + 17);
      rise |= Pack16(Hits16(right0, left0, least), Hits16(right1, left1, least)) << (32 * part);
      fall |= Pack16(Hits16(left0, right0, least), Hits16(left1, right1, least)) << (32 * part);
    }
    rises[x >> 6] = rise;
    falls[x >> 6] = fall;
  }
  ScalarBits(row, x, width - 1, threshold, rises, falls);
}

}  // namespace videogrammetry::gradient_mask
