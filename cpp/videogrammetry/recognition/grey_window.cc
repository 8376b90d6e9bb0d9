#include "videogrammetry/recognition/grey_window.h"

#include <algorithm>
#include <cstdint>
#include <type_traits>

#include "videogrammetry/recognition/grey_window_kernels.h"

namespace videogrammetry {
namespace {

constexpr std::ptrdiff_t kAlign = 16;  // floats in the widest register

const grey_window::Kernels& KernelsOf([[maybe_unused]] InstructionSet set) {
#ifdef VIDEOGRAMMETRY_X86_KERNELS
  if (set == InstructionSet::kAvx512) return grey_window::Avx512Kernels();
  if (set == InstructionSet::kAvx2) return grey_window::Avx2Kernels();
#endif
  return grey_window::BaselineKernels();
}

}  // namespace

int FrameWidth(const FrameView& frame) {
  return std::visit([](const auto& view) { return view.width(); }, frame);
}

int FrameHeight(const FrameView& frame) {
  return std::visit([](const auto& view) { return view.height(); }, frame);
}

float GreyWindow::Bilinear(float x, float y) const {
  const float px = x - static_cast<float>(x0), py = y - static_cast<float>(y0);
  float out = 0.0f;
  grey_window::BaselineKernels().sample(data, stride, &px, &py, 1, &out);
  return out;
}

void GreyWindow::Sample(const float* x, const float* y, int count, float* out) const {
  // In parts, so that the shifted coordinates stay on the stack.
  constexpr int kPart = 256;
  float px[kPart], py[kPart];
  const auto left = static_cast<float>(x0), top = static_cast<float>(y0);
  const auto& kernels = KernelsOf(set);
  for (int begin = 0; begin < count; begin += kPart) {
    const int n = std::min(kPart, count - begin);
    for (int k = 0; k < n; ++k) {
      px[k] = x[begin + k] - left;
      py[k] = y[begin + k] - top;
    }
    kernels.sample(data, stride, px, py, n, out + begin);
  }
}

WindowReader::WindowReader(const FrameView& frame, int sign, InstructionSet set)
    : frame_(frame),
      sign_(sign),
      set_(set),
      width_(FrameWidth(frame)),
      height_(FrameHeight(frame)) {}

GreyWindow WindowReader::Read(int x0, int y0, int x1, int y1) {
  GreyWindow window;
  window.set = set_;
  window.x0 = std::max(0, x0);
  window.y0 = std::max(0, y0);
  window.width = std::max(0, std::min(width_ - 1, x1) - window.x0 + 1);
  window.height = std::max(0, std::min(height_ - 1, y1) - window.y0 + 1);
  // A row of 12-bit samples is read from an even one on: one float more.
  window.stride = (window.width + 2 * kAlign) / kAlign * kAlign;
  const auto needed = static_cast<std::size_t>(window.stride * (window.height + 1) + kAlign);
  if (buffer_.size() < needed) buffer_.resize(needed);
  const auto address = reinterpret_cast<std::uintptr_t>(buffer_.data());
  const auto past = static_cast<std::ptrdiff_t>(address / sizeof(float)) % kAlign;
  float* begin = buffer_.data() + (kAlign - past) % kAlign;
  window.data = begin;
  if (window.width == 0 || window.height == 0) return window;
  const auto& kernels = KernelsOf(set_);
  const auto sign = static_cast<float>(sign_);
  for (int y = 0; y < window.height; ++y) {
    float* out = begin + y * window.stride;
    std::visit(
        [&](const auto& view) {
          using View = std::decay_t<decltype(view)>;
          if constexpr (std::is_same_v<View, ImageView8>) {
            kernels.row8(view.row(window.y0 + y) + window.x0, window.width, sign, out);
          } else if constexpr (std::is_same_v<View, ImageView16>) {
            kernels.row16(view.row(window.y0 + y) + window.x0, window.width, sign, out);
          } else {
            const std::uint8_t* packed = view.row(window.y0 + y) + window.x0 / 2 * 3;
            const bool high = view.order() == PackedOrder::kHighFirst;
            if (window.x0 % 2 == 0) {
              kernels.row12(packed, high, window.width, sign, out);
            } else {
              out[0] = sign * static_cast<float>(view(window.x0, window.y0 + y));
              kernels.row12(packed + 3, high, window.width - 1, sign, out + 1);
            }
          }
        },
        frame_);
    std::fill(out + window.width, out + window.stride, 0.0f);
  }
  return window;
}

}  // namespace videogrammetry
