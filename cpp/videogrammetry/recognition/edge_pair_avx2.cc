// Compiled with AVX2 enabled; reached through edge_pair_samples.cc alone.
#include <immintrin.h>

#include "videogrammetry/recognition/edge_pair_kernels.h"

namespace videogrammetry::edge_pair {
namespace {

constexpr int kUnpacked = 16;

inline __m128i Load128(const std::uint8_t* p) {
  return _mm_loadu_si128(reinterpret_cast<const __m128i*>(p));
}

inline __m256i Load256(const std::uint8_t* p) {
  return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(p));
}

// 16 samples as words.
template <Storage S>
inline __m256i Load(const std::uint8_t* p) {
  if constexpr (S == kBytes) {
    return _mm256_cvtepu8_epi16(Load128(p));
  } else if constexpr (S == kWords) {
    return Load256(p);
  } else {
    // Bytes 0 ... 15 and 8 ... 23, so that nothing beyond the 24 is read: the upper
    // half's samples begin with its fifth byte.
    const __m256i bytes =
        _mm256_inserti128_si256(_mm256_castsi128_si256(Load128(p)), Load128(p + 8), 1);
    const __m256i shuffle =
        S == kPackedHighFirst
            ? _mm256_setr_epi8(1, 0, 2, 1, 4, 3, 5, 4, 7, 6, 8, 7, 10, 9, 11, 10, 5, 4, 6, 5, 8, 7,
                               9, 8, 11, 10, 12, 11, 14, 13, 15, 14)
            : _mm256_setr_epi8(0, 1, 1, 2, 3, 4, 4, 5, 6, 7, 7, 8, 9, 10, 10, 11, 4, 5, 5, 6, 7, 8,
                               8, 9, 10, 11, 11, 12, 13, 14, 14, 15);
    // The sample is the word's upper 12 bits or its lower ones, by turns.
    const __m256i factor = _mm256_set1_epi32(S == kPackedHighFirst ? 0x00100001 : 0x00010010);
    return _mm256_srli_epi16(_mm256_mullo_epi16(_mm256_shuffle_epi8(bytes, shuffle), factor), 4);
  }
}

template <Storage S>
inline const std::uint8_t* Ahead(const std::uint8_t* p, int samples) {
  return S == kBytes ? p + samples : S == kWords ? p + 2 * samples : p + samples / 2 * 3;
}

inline std::uint64_t Bits(__m256i bytes) {
  return static_cast<std::uint32_t>(_mm256_movemask_epi8(bytes));
}

inline std::uint64_t Bits(__m256i low, __m256i high) {
  return Bits(_mm256_permute4x64_epi64(_mm256_packs_epi16(low, high), 0xd8));
}

// Lanes where a - b reaches `least`.
inline __m256i Reaches8(__m256i a, __m256i b, __m256i least) {
  const __m256i difference = _mm256_subs_epu8(a, b);
  return _mm256_cmpeq_epi8(_mm256_max_epu8(difference, least), difference);
}

inline __m256i Reaches16(__m256i a, __m256i b, __m256i least) {
  const __m256i difference = _mm256_subs_epu16(a, b);
  return _mm256_cmpeq_epi16(_mm256_max_epu16(difference, least), difference);
}

template <Storage S>
inline void Edges(const std::uint8_t* p, int threshold, std::uint64_t* rises,
                  std::uint64_t* falls) {
  *rises = *falls = 0;
  if (threshold > 65534) return;
  for (int half = 0; half < 2; ++half) {
    std::uint64_t rise, fall;
    if constexpr (S == kBytes) {
      const __m256i least = _mm256_set1_epi8(static_cast<char>(threshold + 1));
      const __m256i left = Load256(p + 32 * half), right = Load256(p + 32 * half + 2);
      rise = Bits(Reaches8(right, left, least));
      fall = Bits(Reaches8(left, right, least));
    } else {
      const __m256i least = _mm256_set1_epi16(static_cast<short>(threshold + 1));
      const __m256i left0 = Load<S>(Ahead<S>(p, 32 * half));
      const __m256i right0 = Load<S>(Ahead<S>(p, 32 * half + 2));
      const __m256i left1 = Load<S>(Ahead<S>(p, 32 * half + 16));
      const __m256i right1 = Load<S>(Ahead<S>(p, 32 * half + 18));
      rise = Bits(Reaches16(right0, left0, least), Reaches16(right1, left1, least));
      fall = Bits(Reaches16(left0, right0, least), Reaches16(left1, right1, least));
    }
    *rises |= rise << (32 * half);
    *falls |= fall << (32 * half);
  }
}

// What the threshold grows by at bytes, and at words.
inline __m256i Growth8(__m256i grey, const Growth& growth) {
  const __m256i factor = _mm256_set1_epi16(static_cast<short>(growth.per_grey));
  const __m256i over = _mm256_subs_epu8(grey, _mm256_set1_epi8(static_cast<char>(growth.from)));
  const __m256i even = _mm256_and_si256(over, _mm256_set1_epi16(0xff));
  const __m256i odd = _mm256_srli_epi16(over, 8);
  const __m256i by = _mm256_or_si256(_mm256_mulhi_epu16(even, factor),
                                     _mm256_slli_epi16(_mm256_mulhi_epu16(odd, factor), 8));
  const int most = growth.most < 255 ? growth.most : 255;
  return _mm256_min_epu8(by, _mm256_set1_epi8(static_cast<char>(most)));
}

inline __m256i Growth16(__m256i grey, const Growth& growth) {
  const __m256i factor = _mm256_set1_epi16(static_cast<short>(growth.per_grey));
  const __m256i over = _mm256_subs_epu16(grey, _mm256_set1_epi16(static_cast<short>(growth.from)));
  return _mm256_min_epu16(_mm256_mulhi_epu16(over, factor),
                          _mm256_set1_epi16(static_cast<short>(growth.most)));
}

// Lanes where a, less what the threshold grows by there, exceeds b by `least`.
inline __m256i ReachesAbove16(__m256i a, __m256i b, __m256i least, const Growth& growth) {
  return Reaches16(_mm256_sub_epi16(a, Growth16(a, growth)), b, least);
}

template <Storage S>
inline void EdgesAbove(const std::uint8_t* p, int threshold, const Growth& growth,
                       std::uint64_t* rises, std::uint64_t* falls) {
  *rises = *falls = 0;
  if (threshold > 65534) return;
  for (int half = 0; half < 2; ++half) {
    std::uint64_t rise, fall;
    if constexpr (S == kBytes) {
      const __m256i least = _mm256_set1_epi8(static_cast<char>(threshold + 1));
      const __m256i left = Load256(p + 32 * half), right = Load256(p + 32 * half + 2);
      rise = Bits(Reaches8(_mm256_sub_epi8(right, Growth8(right, growth)), left, least));
      fall = Bits(Reaches8(_mm256_sub_epi8(left, Growth8(left, growth)), right, least));
    } else {
      const __m256i least = _mm256_set1_epi16(static_cast<short>(threshold + 1));
      const __m256i left0 = Load<S>(Ahead<S>(p, 32 * half));
      const __m256i right0 = Load<S>(Ahead<S>(p, 32 * half + 2));
      const __m256i left1 = Load<S>(Ahead<S>(p, 32 * half + 16));
      const __m256i right1 = Load<S>(Ahead<S>(p, 32 * half + 18));
      rise = Bits(ReachesAbove16(right0, left0, least, growth),
                  ReachesAbove16(right1, left1, least, growth));
      fall = Bits(ReachesAbove16(left0, right0, least, growth),
                  ReachesAbove16(left1, right1, least, growth));
    }
    *rises |= rise << (32 * half);
    *falls |= fall << (32 * half);
  }
}

template <Storage S>
inline void Unpack(const std::uint8_t* p, std::uint16_t flip, std::uint16_t* out) {
  const __m256i flips = _mm256_set1_epi16(static_cast<short>(flip));
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(out), _mm256_xor_si256(Load<S>(p), flips));
}

}  // namespace
}  // namespace videogrammetry::edge_pair

#include "videogrammetry/recognition/edge_pair_kernels.inc"

const Kernels* Avx2Kernels() { return kTable; }

}  // namespace videogrammetry::edge_pair
