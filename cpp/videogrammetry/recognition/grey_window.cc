#include "videogrammetry/recognition/grey_window.h"

#include <algorithm>
#include <cstdint>

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

void WindowReader::ReadRows(const ImageView8& view, const GreyWindow& window, int count,
                            float* out) const {
  const auto& kernels = KernelsOf(set_);
  for (int y = 0; y < window.height; ++y, out += window.stride) {
    kernels.row8(view.row(window.y0 + y) + window.x0, count, static_cast<float>(sign_), out);
  }
}

void WindowReader::ReadRows(const ImageView16& view, const GreyWindow& window, int count,
                            float* out) const {
  const auto& kernels = KernelsOf(set_);
  for (int y = 0; y < window.height; ++y, out += window.stride) {
    kernels.row16(view.row(window.y0 + y) + window.x0, count, static_cast<float>(sign_), out);
  }
}

void WindowReader::ReadRows(const Packed12View& view, const GreyWindow& window, int count,
                            float* out) const {
  const auto& kernels = KernelsOf(set_);
  const auto sign = static_cast<float>(sign_);
  const bool high = view.order() == PackedOrder::kHighFirst;
  const int odd = window.x0 % 2;  // packed samples are read from an even one on
  for (int y = 0; y < window.height; ++y, out += window.stride) {
    const int row = window.y0 + y;
    if (odd != 0) out[0] = sign * static_cast<float>(view(window.x0, row));
    kernels.row12(view.row(row) + (window.x0 + odd) / 2 * 3, high, count - odd, sign, out + odd);
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
  window.x0 = std::max(0, x0);
  window.y0 = std::max(0, y0);
  window.width = std::max(0, std::min(width_ - 1, x1) - window.x0 + 1);
  window.height = std::max(0, std::min(height_ - 1, y1) - window.y0 + 1);
  window.stride = (window.width + 2 * kAlign) / kAlign * kAlign;
  const auto needed = static_cast<std::size_t>(window.stride * (window.height + 1) + kAlign);
  if (buffer_.size() < needed) buffer_.resize(needed);
  const auto address = reinterpret_cast<std::uintptr_t>(buffer_.data());
  const auto past = static_cast<std::ptrdiff_t>(address / sizeof(float)) % kAlign;
  float* begin = buffer_.data() + (kAlign - past) % kAlign;
  window.data = begin;
  if (window.width == 0 || window.height == 0) return window;
  // Whole groups of floats, as far as the picture's row goes: what lies beyond a window's
  // row is never looked at, but loaded.
  const int left = width_ - window.x0;
  const int count = std::min(left, static_cast<int>(window.stride - kAlign));
  std::visit([&](const auto& view) { ReadRows(view, window, count, begin); }, frame_);
  return window;
}

}  // namespace videogrammetry
