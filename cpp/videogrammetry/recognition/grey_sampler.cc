#include "videogrammetry/recognition/grey_sampler.h"

#include <variant>

#include "videogrammetry/recognition/bilinear.h"

namespace videogrammetry {
namespace {

template <typename T>
void SampleView(const ImageView<T>& view, InstructionSet set, int left, int top, const float* x,
                const float* y, int count, float* out) {
  SelectBilinear<T>(set)(view.row(top) + left, view.stride(), x, y, count, out);
}

void SampleView(const Packed12View& view, InstructionSet set, int left, int top, const float* x,
                const float* y, int count, float* out) {
  SelectBilinearPacked12(set)(view.row(top), view.stride_bytes(),
                              view.order() == PackedOrder::kHighFirst, left, x, y, count, out);
}

}  // namespace

GreySampler::GreySampler(const FrameView& frame, int sign, InstructionSet set)
    : frame_(frame),
      set_(set),
      sign_(sign),
      width_(FrameWidth(frame)),
      height_(FrameHeight(frame)) {}

void GreySampler::Sample(int left, int top, int bottom, const float* x, const float* y, int count,
                         float* out) const {
  // The fast kernels read a few bytes more than they need: of the next row, if there is one.
  const bool has_next = bottom + 1 < height_ && width_ > kBilinearMargin;
  const InstructionSet set = has_next ? set_ : InstructionSet::kBaseline;
  std::visit([&](const auto& view) { SampleView(view, set, left, top, x, y, count, out); }, frame_);
  if (sign_ > 0) return;
  for (int k = 0; k < count; ++k) out[k] = -out[k];
}

float GreySampler::At(double x, double y) const {
  const int left = static_cast<int>(x), top = static_cast<int>(y);
  const auto px = static_cast<float>(x - left), py = static_cast<float>(y - top);
  float out = 0.0f;
  Sample(left, top, top + 1, &px, &py, 1, &out);
  return out;
}

}  // namespace videogrammetry
