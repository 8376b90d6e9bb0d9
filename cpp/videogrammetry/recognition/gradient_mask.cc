#include "videogrammetry/recognition/gradient_mask.h"

#include "videogrammetry/recognition/gradient_mask_kernels.h"

namespace videogrammetry {
namespace gradient_mask {
namespace {

template <typename T>
void Portable(const T* row, int width, int threshold, std::uint64_t* rises, std::uint64_t* falls) {
  for (int i = 0; i < (width + 63) / 64; ++i) rises[i] = falls[i] = 0;
  ScalarBits(row, 1, width - 1, threshold, rises, falls);
}

}  // namespace

void Baseline8(const std::uint8_t* row, int width, int threshold, std::uint64_t* rises,
               std::uint64_t* falls) {
  Portable(row, width, threshold, rises, falls);
}

void Baseline16(const std::uint16_t* row, int width, int threshold, std::uint64_t* rises,
                std::uint64_t* falls) {
  Portable(row, width, threshold, rises, falls);
}

}  // namespace gradient_mask

template <>
GradientMaskRow<std::uint8_t> SelectGradientMask([[maybe_unused]] InstructionSet set) {
#ifdef VIDEOGRAMMETRY_X86_KERNELS
  if (set == InstructionSet::kAvx512) return gradient_mask::Avx512Mask8;
  if (set == InstructionSet::kAvx2) return gradient_mask::Avx2Mask8;
#endif
  return gradient_mask::Baseline8;
}

template <>
GradientMaskRow<std::uint16_t> SelectGradientMask([[maybe_unused]] InstructionSet set) {
#ifdef VIDEOGRAMMETRY_X86_KERNELS
  if (set == InstructionSet::kAvx512) return gradient_mask::Avx512Mask16;
  if (set == InstructionSet::kAvx2) return gradient_mask::Avx2Mask16;
#endif
  return gradient_mask::Baseline16;
}

}  // namespace videogrammetry
