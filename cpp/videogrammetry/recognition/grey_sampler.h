#pragma once

#include "videogrammetry/core/cpu.h"
#include "videogrammetry/recognition/grey_window.h"

namespace videogrammetry {

/// Grey values between the pixels of a picture of any depth, straight from its samples:
/// bright targets up, times +1 (white on black) or -1 (black on white).
class GreySampler {
 public:
  GreySampler(const FrameView& frame, int sign, InstructionSet set = DetectInstructionSet());

  /// True if the value at (x, y) needs no pixel outside the picture.
  bool Covers(double x, double y) const {
    return x >= 0.0 && y >= 0.0 && x <= width_ - 1.001 && y <= height_ - 1.001;
  }
  /// Bilinear values, paper Eq. (9), at the places (left + x[k], top + y[k]), the same bits
  /// from every instruction set and depth; x[k], y[k] >= 0, Covers() true of each place.
  ///
  /// @param bottom  a row from which on no place lies.
  void Sample(int left, int top, int bottom, const float* x, const float* y, int count,
              float* out) const;
  float At(double x, double y) const;  ///< the same at one place

 private:
  FrameView frame_;
  InstructionSet set_;
  int sign_, width_, height_;
};

}  // namespace videogrammetry
