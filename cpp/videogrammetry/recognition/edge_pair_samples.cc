#include "videogrammetry/recognition/edge_pair_samples.h"

#include <type_traits>

namespace videogrammetry::edge_pair {
namespace {

const Kernels* TableOf([[maybe_unused]] InstructionSet set) {
#ifdef VIDEOGRAMMETRY_X86_KERNELS
  if (set == InstructionSet::kAvx512) return Avx512Kernels();
  if (set == InstructionSet::kAvx2) return Avx2Kernels();
#endif
  return BaselineKernels();
}

}  // namespace

SampleRows::SampleRows(const FrameView& frame, int sign, InstructionSet set)
    : width(FrameWidth(frame)), height(FrameHeight(frame)), flip(sign > 0 ? 0 : 65535) {
  std::visit(
      [&](const auto& view) {
        using View = std::decay_t<decltype(view)>;
        if constexpr (std::is_same_v<View, ImageView8>) {
          data = view.data();
          stride_bytes = view.stride();
        } else if constexpr (std::is_same_v<View, ImageView16>) {
          storage = kWords;
          data = reinterpret_cast<const std::uint8_t*>(view.data());
          stride_bytes = 2 * view.stride();
        } else {
          storage = view.order() == PackedOrder::kHighFirst ? kPackedHighFirst : kPackedLowFirst;
          data = view.data();
          stride_bytes = view.stride_bytes();
        }
      },
      frame);
  kernels = TableOf(set) + storage;
}

}  // namespace videogrammetry::edge_pair
