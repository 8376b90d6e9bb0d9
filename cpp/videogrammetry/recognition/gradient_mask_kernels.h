#pragma once

// Private to the gradient mask: the same kernel for each instruction set. The
// files that define them are compiled with flags of their own, so nothing that
// is inlined elsewhere may be defined or instantiated in them.

#include <cstdint>

namespace videogrammetry::gradient_mask {

/// Bits of pixels [begin, end) are OR-ed into words that the caller has zeroed.
template <typename T>
static inline void ScalarBits(const T* row, int begin, int end, int threshold, std::uint64_t* rises,
                              std::uint64_t* falls) {
  for (int x = begin; x < end; ++x) {
    const int g = static_cast<int>(row[x + 1]) - static_cast<int>(row[x - 1]);
    rises[x >> 6] |= static_cast<std::uint64_t>(g > threshold) << (x & 63);
    falls[x >> 6] |= static_cast<std::uint64_t>(g < -threshold) << (x & 63);
  }
}

void Baseline8(const std::uint8_t* row, int width, int threshold, std::uint64_t* rises,
               std::uint64_t* falls);
void Baseline16(const std::uint16_t* row, int width, int threshold, std::uint64_t* rises,
                std::uint64_t* falls);
void Avx2Mask8(const std::uint8_t* row, int width, int threshold, std::uint64_t* rises,
               std::uint64_t* falls);
void Avx2Mask16(const std::uint16_t* row, int width, int threshold, std::uint64_t* rises,
                std::uint64_t* falls);
void Avx512Mask8(const std::uint8_t* row, int width, int threshold, std::uint64_t* rises,
                 std::uint64_t* falls);
void Avx512Mask16(const std::uint16_t* row, int width, int threshold, std::uint64_t* rises,
                  std::uint64_t* falls);

}  // namespace videogrammetry::gradient_mask
