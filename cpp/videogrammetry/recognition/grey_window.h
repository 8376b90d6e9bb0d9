#pragma once

#include <cstddef>
#include <variant>
#include <vector>

#include "videogrammetry/core/cpu.h"
#include "videogrammetry/core/image_view.h"
#include "videogrammetry/core/packed12_view.h"

namespace videogrammetry {

/// A picture of any depth, as it lies in memory.
using FrameView = std::variant<ImageView8, ImageView16, Packed12View>;

int FrameWidth(const FrameView& frame);
int FrameHeight(const FrameView& frame);

/// A part of a picture as floats, bright targets up: grey values times +1
/// (white on black) or -1 (black on white). Coordinates are the picture's.
struct GreyWindow {
  int x0 = 0, y0 = 0;  ///< its first pixel's place in the picture
  int width = 0, height = 0;
  std::ptrdiff_t stride = 0;    ///< floats from row to row: a multiple of 16, more than width + 15
  const float* data = nullptr;  ///< beyond a row's end stands anything

  const float* row(int y) const { return data + (y - y0) * stride; }
  float operator()(int x, int y) const { return row(y)[x - x0]; }
};

/// Reads windows of a picture, converting each sample once; keeps its memory.
class WindowReader {
 public:
  /// @param sign  +1 or -1.
  WindowReader(const FrameView& frame, int sign, InstructionSet set = DetectInstructionSet());

  int width() const { return width_; }
  int height() const { return height_; }
  int sign() const { return sign_; }
  InstructionSet set() const { return set_; }
  const FrameView& frame() const { return frame_; }

  /// The window of pixels x0 ... x1, y0 ... y1 inclusive, clipped to the picture
  /// (width or height 0 where nothing is left). Valid until the next call.
  GreyWindow Read(int x0, int y0, int x1, int y1);
  /// Has the memory of a window come near before it is read: a window's rows lie far apart, and
  /// waiting for each takes longer than all that is done with it.
  void Prefetch(int x0, int y0, int x1, int y1) const;

 private:
  void ReadRows(const ImageView8& view, const GreyWindow& window, int count, float* out) const;
  void ReadRows(const ImageView16& view, const GreyWindow& window, int count, float* out) const;
  void ReadRows(const Packed12View& view, const GreyWindow& window, int count, float* out) const;

  FrameView frame_;
  int sign_;
  InstructionSet set_;
  int width_, height_;
  std::vector<float> buffer_;
};

}  // namespace videogrammetry
