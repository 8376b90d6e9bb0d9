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

/// A load whose value nobody waits for. (A prefetch is dropped where the page's place is not
/// known yet, which of a mapped recording is most often so.)
void Touch(const char* address) { static_cast<void>(*static_cast<const volatile char*>(address)); }

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
  const std::ptrdiff_t first = window.x0 / 2 * 3;
  const int wanted = window.width + window.x0 % 2;
  const int groups = (wanted + grey_window::kGroup12 - 1) / grey_window::kGroup12;
  const auto loaded = groups * (grey_window::kGroup12 / 2 * 3) + grey_window::kBeyond12;
  const std::uint8_t* last = view.row(window.y0 + window.height - 1) + first;
  if (last + loaded <= view.row(view.height())) {
    kernels.rows12(view.row(window.y0) + first, view.stride_bytes(), high, window.height, wanted,
                   sign, out, window.stride);
    return;
  }
  for (int y = 0; y < window.height; ++y, out += window.stride) {
    kernels.row12(view.row(window.y0 + y) + first, high, count, sign, out);
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
  // Packed samples are read from an even one on.
  const int before = std::holds_alternative<Packed12View>(frame_) ? window.x0 % 2 : 0;
  window.stride = (window.width + before + 2 * kAlign) / kAlign * kAlign;
  const auto needed = static_cast<std::size_t>(window.stride * (window.height + 1) + kAlign);
  if (buffer_.size() < needed) buffer_.resize(needed);
  const auto address = reinterpret_cast<std::uintptr_t>(buffer_.data());
  const auto past = static_cast<std::ptrdiff_t>(address / sizeof(float)) % kAlign;
  float* begin = buffer_.data() + (kAlign - past) % kAlign;
  window.data = begin + before;
  if (window.width == 0 || window.height == 0) return window;
  // Whole groups of floats, as far as the picture's row goes: what lies beyond a window's
  // row is never looked at, but loaded.
  const int left = width_ - window.x0 + before;
  const int count = std::min(left, static_cast<int>(window.stride - kAlign));
  std::visit([&](const auto& view) { ReadRows(view, window, count, begin); }, frame_);
  return window;
}

void WindowReader::Prefetch(int x0, int y0, int x1, int y1) const {
  constexpr int kLineBytes = 64;
  x0 = std::max(0, x0), y0 = std::max(0, y0);
  x1 = std::min(width_ - 1, x1), y1 = std::min(height_ - 1, y1);
  if (x1 < x0) return;
  std::visit(
      [&](const auto& view) {
        constexpr bool kPacked = std::is_same_v<std::decay_t<decltype(view)>, Packed12View>;
        for (int y = y0; y <= y1; ++y) {
          const auto* row = reinterpret_cast<const char*>(view.row(y));
          std::ptrdiff_t from, to;
          if constexpr (kPacked) {
            from = x0 / 2 * 3, to = x1 / 2 * 3 + 2;
          } else {
            from = x0 * static_cast<std::ptrdiff_t>(sizeof(*view.row(y)));
            to = x1 * static_cast<std::ptrdiff_t>(sizeof(*view.row(y)));
          }
          for (std::ptrdiff_t at = from; at < to; at += kLineBytes) Touch(row + at);
          Touch(row + to);
        }
      },
      frame_);
}

}  // namespace videogrammetry
