#include "videogrammetry/recognition/bilinear.h"

#include "videogrammetry/recognition/bilinear_kernels.h"

namespace videogrammetry {
namespace bilinear {

void Baseline8(const std::uint8_t* image, std::ptrdiff_t stride, const float* x, const float* y,
               int count, float* out) {
  ScalarSamples(image, stride, x, y, 0, count, out);
}

void Baseline16(const std::uint16_t* image, std::ptrdiff_t stride, const float* x, const float* y,
                int count, float* out) {
  ScalarSamples(image, stride, x, y, 0, count, out);
}

void BaselinePacked12(const std::uint8_t* rows, std::ptrdiff_t stride, bool high_first, int left,
                      const float* x, const float* y, int count, float* out) {
  ScalarPacked12(rows, stride, high_first, left, x, y, 0, count, out);
}

}  // namespace bilinear

template <>
BilinearKernel<std::uint8_t> SelectBilinear([[maybe_unused]] InstructionSet set) {
#ifdef VIDEOGRAMMETRY_X86_KERNELS
  if (set == InstructionSet::kAvx512) return bilinear::Avx512Samples8;
  if (set == InstructionSet::kAvx2) return bilinear::Avx2Samples8;
#endif
  return bilinear::Baseline8;
}

template <>
BilinearKernel<std::uint16_t> SelectBilinear([[maybe_unused]] InstructionSet set) {
#ifdef VIDEOGRAMMETRY_X86_KERNELS
  if (set == InstructionSet::kAvx512) return bilinear::Avx512Samples16;
  if (set == InstructionSet::kAvx2) return bilinear::Avx2Samples16;
#endif
  return bilinear::Baseline16;
}

BilinearPacked12Kernel SelectBilinearPacked12([[maybe_unused]] InstructionSet set) {
#ifdef VIDEOGRAMMETRY_X86_KERNELS
  if (set == InstructionSet::kAvx512) return bilinear::Avx512Packed12;
  if (set == InstructionSet::kAvx2) return bilinear::Avx2Packed12;
#endif
  return bilinear::BaselinePacked12;
}

}  // namespace videogrammetry
