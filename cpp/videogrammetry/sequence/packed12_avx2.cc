#include <immintrin.h>

#include "videogrammetry/sequence/packed12_kernels.h"

namespace videogrammetry::packed12 {
namespace {

// Each 128-bit lane gets 12 bytes and makes 8 samples of them: the shuffle puts the
// two bytes that a sample lies in into a 16-bit word, higher byte last (x86 is
// little-endian); one sample of a pair then wants a shift by 4, the other a mask.
template <PackedOrder kOrder>
std::size_t Unpack(const std::uint8_t* packed, std::size_t num_bytes, std::uint16_t* samples,
                   std::size_t num_samples) {
  constexpr bool kHigh = kOrder == PackedOrder::kHighFirst;
  const __m256i shuffle = kHigh
                              ? _mm256_setr_epi8(1, 0, 2, 1, 4, 3, 5, 4, 7, 6, 8, 7, 10, 9, 11, 10,
                                                 1, 0, 2, 1, 4, 3, 5, 4, 7, 6, 8, 7, 10, 9, 11, 10)
                              : _mm256_setr_epi8(0, 1, 1, 2, 3, 4, 4, 5, 6, 7, 7, 8, 9, 10, 10, 11,
                                                 0, 1, 1, 2, 3, 4, 4, 5, 6, 7, 7, 8, 9, 10, 10, 11);
  const __m256i mask = _mm256_set1_epi16(0x0fff);
  constexpr int kMasked = kHigh ? 0xaa : 0x55;  // the samples of a pair that are masked
  std::size_t done = 0;
  // The upper lane's load begins 12 bytes on and takes 16: 28 must be there.
  for (std::size_t at = 0; done + 16 <= num_samples && at + 28 <= num_bytes; at += 24, done += 16) {
    const __m128i low = _mm_loadu_si128(reinterpret_cast<const __m128i*>(packed + at));
    const __m128i high = _mm_loadu_si128(reinterpret_cast<const __m128i*>(packed + at + 12));
    const __m256i words = _mm256_shuffle_epi8(_mm256_set_m128i(high, low), shuffle);
    const __m256i both =
        _mm256_blend_epi16(_mm256_srli_epi16(words, 4), _mm256_and_si256(words, mask), kMasked);
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(samples + done), both);
  }
  return done;
}

}  // namespace

std::size_t Avx2Unpack(const std::uint8_t* packed, std::size_t num_bytes, PackedOrder order,
                       std::uint16_t* samples, std::size_t num_samples) {
  return order == PackedOrder::kHighFirst
             ? Unpack<PackedOrder::kHighFirst>(packed, num_bytes, samples, num_samples)
             : Unpack<PackedOrder::kLowFirst>(packed, num_bytes, samples, num_samples);
}

}  // namespace videogrammetry::packed12
