// Compiled with AVX-512 F, BW, VL and DQ enabled; reached through SelectGradientMask alone.
#include <immintrin.h>

#include "videogrammetry/recognition/gradient_mask_kernels.h"

namespace videogrammetry::gradient_mask {

void Avx512Mask8(const std::uint8_t* row, int width, int threshold, std::uint64_t* rises,
                 std::uint64_t* falls) {
  const int words = (width + 63) / 64;
  for (int i = 0; i < words; ++i) rises[i] = falls[i] = 0;
  const __m512i limit = _mm512_set1_epi8(static_cast<char>(threshold));
  ScalarBits(row, 1, width - 1 < 64 ? width - 1 : 64, threshold, rises, falls);
  int x = 64;
  for (; x + 64 < width; x += 64) {
    const __m512i left = _mm512_loadu_si512(row + x - 1), right = _mm512_loadu_si512(row + x + 1);
    rises[x >> 6] = _mm512_cmpgt_epu8_mask(_mm512_subs_epu8(right, left), limit);
    falls[x >> 6] = _mm512_cmpgt_epu8_mask(_mm512_subs_epu8(left, right), limit);
  }
  ScalarBits(row, x, width - 1, threshold, rises, falls);
}

void Avx512Mask16(const std::uint16_t* row, int width, int threshold, std::uint64_t* rises,
                  std::uint64_t* falls) {
  const int words = (width + 63) / 64;
  for (int i = 0; i < words; ++i) rises[i] = falls[i] = 0;
  const __m512i limit = _mm512_set1_epi16(static_cast<short>(threshold));
  ScalarBits(row, 1, width - 1 < 64 ? width - 1 : 64, threshold, rises, falls);
  int x = 64;
  for (; x + 64 < width; x += 64) {
    std::uint64_t rise = 0, fall = 0;
    for (int part = 0; part < 2; ++part) {
      const std::uint16_t* p = row + x + 32 * part;
      const __m512i left = _mm512_loadu_si512(p - 1), right = _mm512_loadu_si512(p + 1);
      const std::uint64_t up = _mm512_cmpgt_epu16_mask(_mm512_subs_epu16(right, left), limit);
      const std::uint64_t down = _mm512_cmpgt_epu16_mask(_mm512_subs_epu16(left, right), limit);
      rise |= up << (32 * part);
      fall |= down << (32 * part);
    }
    rises[x >> 6] = rise;
    falls[x >> 6] = fall;
  }
  ScalarBits(row, x, width - 1, threshold, rises, falls);
}

}  // namespace videogrammetry::gradient_mask
