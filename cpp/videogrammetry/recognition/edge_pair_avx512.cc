// Compiled with AVX-512 F, BW, VL and DQ enabled; reached through edge_pair_samples.cc alone.
#include <immintrin.h>

#include "videogrammetry/recognition/edge_pair_kernels.h"

namespace videogrammetry::edge_pair {
namespace {

constexpr int kUnpacked = 32;

template <Storage S>
inline __m512i Shuffle() {
  // Both bytes of each sample as one little-endian word. Every 128-bit lane holds 12
  // bytes: four pairs of samples.
  return _mm512_broadcast_i32x4(
      S == kPackedHighFirst ? _mm_setr_epi8(1, 0, 2, 1, 4, 3, 5, 4, 7, 6, 8, 7, 10, 9, 11, 10)
                            : _mm_setr_epi8(0, 1, 1, 2, 3, 4, 4, 5, 6, 7, 7, 8, 9, 10, 10, 11));
}

// 32 samples as words.
template <Storage S>
inline __m512i Load(const std::uint8_t* p) {
  if constexpr (S == kBytes) {
    return _mm512_cvtepu8_epi16(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(p)));
  } else if constexpr (S == kWords) {
    return _mm512_loadu_si512(p);
  } else {
    const __m512i spread = _mm512_setr_epi32(0, 1, 2, 2, 3, 4, 5, 5, 6, 7, 8, 8, 9, 10, 11, 11);
    const __m512i bytes = _mm512_maskz_loadu_epi32(0x0fff, p);
    const __m512i words =
        _mm512_shuffle_epi8(_mm512_permutexvar_epi32(spread, bytes), Shuffle<S>());
    // The sample is the word's upper 12 bits or its lower ones, by turns.
    const __m512i factor = _mm512_set1_epi32(S == kPackedHighFirst ? 0x00100001 : 0x00010010);
    return _mm512_srli_epi16(_mm512_mullo_epi16(words, factor), 4);
  }
}

template <Storage S>
inline const std::uint8_t* Ahead(const std::uint8_t* p, int samples) {
  return S == kBytes ? p + samples : S == kWords ? p + 2 * samples : p + samples / 2 * 3;
}

template <Storage S>
inline void Edges(const std::uint8_t* p, int threshold, std::uint64_t* rises,
                  std::uint64_t* falls) {
  if constexpr (S == kBytes) {
    const __m512i limit = _mm512_set1_epi8(static_cast<char>(threshold));
    const __m512i left = _mm512_loadu_si512(p), right = _mm512_loadu_si512(p + 2);
    *rises = _mm512_cmpgt_epu8_mask(_mm512_subs_epu8(right, left), limit);
    *falls = _mm512_cmpgt_epu8_mask(_mm512_subs_epu8(left, right), limit);
  } else {
    const __m512i limit = _mm512_set1_epi16(static_cast<short>(threshold));
    std::uint64_t rise[2], fall[2];
    for (int half = 0; half < 2; ++half) {
      const __m512i left = Load<S>(Ahead<S>(p, 32 * half));
      const __m512i right = Load<S>(Ahead<S>(p, 32 * half + 2));
      rise[half] = _mm512_cmpgt_epu16_mask(_mm512_subs_epu16(right, left), limit);
      fall[half] = _mm512_cmpgt_epu16_mask(_mm512_subs_epu16(left, right), limit);
    }
    *rises = rise[0] | rise[1] << 32;
    *falls = fall[0] | fall[1] << 32;
  }
}

// What the threshold grows by at bytes, and at words.
inline __m512i Growth8(__m512i grey, const Growth& growth) {
  const __m512i factor = _mm512_set1_epi16(static_cast<short>(growth.per_grey));
  const __m512i over = _mm512_subs_epu8(grey, _mm512_set1_epi8(static_cast<char>(growth.from)));
  const __m512i even = _mm512_and_si512(over, _mm512_set1_epi16(0xff));
  const __m512i odd = _mm512_srli_epi16(over, 8);
  const __m512i by = _mm512_or_si512(_mm512_mulhi_epu16(even, factor),
                                     _mm512_slli_epi16(_mm512_mulhi_epu16(odd, factor), 8));
  const int most = growth.most < 255 ? growth.most : 255;
  return _mm512_min_epu8(by, _mm512_set1_epi8(static_cast<char>(most)));
}

inline __m512i Growth16(__m512i grey, const Growth& growth) {
  const __m512i factor = _mm512_set1_epi16(static_cast<short>(growth.per_grey));
  const __m512i over = _mm512_subs_epu16(grey, _mm512_set1_epi16(static_cast<short>(growth.from)));
  return _mm512_min_epu16(_mm512_mulhi_epu16(over, factor),
                          _mm512_set1_epi16(static_cast<short>(growth.most)));
}

template <Storage S>
inline void EdgesAbove(const std::uint8_t* p, int threshold, const Growth& growth,
                       std::uint64_t* rises, std::uint64_t* falls) {
  if constexpr (S == kBytes) {
    const __m512i limit = _mm512_set1_epi8(static_cast<char>(threshold));
    const __m512i left = _mm512_loadu_si512(p), right = _mm512_loadu_si512(p + 2);
    const __m512i low_left = _mm512_sub_epi8(left, Growth8(left, growth));
    const __m512i low_right = _mm512_sub_epi8(right, Growth8(right, growth));
    *rises = _mm512_cmpgt_epu8_mask(_mm512_subs_epu8(low_right, left), limit);
    *falls = _mm512_cmpgt_epu8_mask(_mm512_subs_epu8(low_left, right), limit);
  } else {
    const __m512i limit = _mm512_set1_epi16(static_cast<short>(threshold));
    std::uint64_t rise[2], fall[2];
    for (int half = 0; half < 2; ++half) {
      const __m512i left = Load<S>(Ahead<S>(p, 32 * half));
      const __m512i right = Load<S>(Ahead<S>(p, 32 * half + 2));
      const __m512i low_left = _mm512_sub_epi16(left, Growth16(left, growth));
      const __m512i low_right = _mm512_sub_epi16(right, Growth16(right, growth));
      rise[half] = _mm512_cmpgt_epu16_mask(_mm512_subs_epu16(low_right, left), limit);
      fall[half] = _mm512_cmpgt_epu16_mask(_mm512_subs_epu16(low_left, right), limit);
    }
    *rises = rise[0] | rise[1] << 32;
    *falls = fall[0] | fall[1] << 32;
  }
}

template <Storage S>
inline void Unpack(const std::uint8_t* p, std::uint16_t flip, std::uint16_t* out) {
  const __m512i flips = _mm512_set1_epi16(static_cast<short>(flip));
  _mm512_storeu_si512(out, _mm512_xor_si512(Load<S>(p), flips));
}

}  // namespace
}  // namespace videogrammetry::edge_pair

#include "videogrammetry/recognition/edge_pair_kernels.inc"

const Kernels* Avx512Kernels() { return kTable; }

}  // namespace videogrammetry::edge_pair
