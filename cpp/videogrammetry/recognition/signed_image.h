#pragma once

#include <algorithm>
#include <cmath>

#include "videogrammetry/core/cpu.h"
#include "videogrammetry/core/image_view.h"
#include "videogrammetry/recognition/bilinear.h"

namespace videogrammetry {

/// A picture whose targets are bright: grey values times +1 (white on black)
/// or -1 (black on white), so that no stage needs to know the polarity.
template <typename T>
class SignedImage {
 public:
  SignedImage(const ImageView<T>& view, int sign, InstructionSet set = DetectInstructionSet())
      : view_(view), sign_(sign), bilinear_(SelectBilinear<T>(set)) {
    // The kernels' offsets have 32 bits.
    if (view.stride() * view.height() > (std::ptrdiff_t{1} << 30)) {
      bilinear_ = SelectBilinear<T>(InstructionSet::kBaseline);
    }
  }

  int operator()(int x, int y) const { return sign_ * static_cast<int>(view_(x, y)); }
  const T* row(int y) const { return view_.row(y); }
  int sign() const { return sign_; }
  int width() const { return view_.width(); }
  int height() const { return view_.height(); }
  const ImageView<T>& view() const { return view_; }

  /// True if the bilinear value at (x, y) needs no pixel outside the picture.
  bool Covers(double x, double y) const {
    return x >= 0.0 && y >= 0.0 && x <= width() - 1.001 && y <= height() - 1.001;
  }

  /// True if every place within `reach` of (x, y) may be passed to Sample.
  bool CoversAround(double x, double y, double reach_x, double reach_y) const {
    return Covers(x - reach_x, y - reach_y) && Covers(x + reach_x + kBilinearMargin, y + reach_y);
  }

  /// Bilinear values at many places; see CoversAround.
  void Sample(const float* x, const float* y, int count, float* out) const {
    bilinear_(view_.data(), view_.stride(), x, y, count, out);
    if (sign_ < 0) {
      for (int k = 0; k < count; ++k) out[k] = -out[k];
    }
  }

  /// Grey value between pixels, paper Eq. (9):
  /// (1-a)(1-b) I(i,j) + a(1-b) I(i+1,j) + (1-a)b I(i,j+1) + ab I(i+1,j+1).
  /// Outside the picture the nearest border value is taken.
  float Bilinear(float x, float y) const {
    return BilinearInside(std::clamp(x, 0.0f, static_cast<float>(width()) - 1.001f),
                          std::clamp(y, 0.0f, static_cast<float>(height()) - 1.001f));
  }

  /// The same where Covers(x, y) is known to be true.
  float BilinearInside(float x, float y) const {
    const int i = static_cast<int>(x), j = static_cast<int>(y);
    const float a = x - static_cast<float>(i), b = y - static_cast<float>(j);
    const T* upper = view_.row(j) + i;
    const T* lower = upper + view_.stride();
    const float top = static_cast<float>(upper[0]) +
                      a * (static_cast<float>(upper[1]) - static_cast<float>(upper[0]));
    const float bottom = static_cast<float>(lower[0]) +
                         a * (static_cast<float>(lower[1]) - static_cast<float>(lower[0]));
    return static_cast<float>(sign_) * (top + b * (bottom - top));
  }

 private:
  ImageView<T> view_;
  int sign_;
  BilinearKernel<T> bilinear_;
};

}  // namespace videogrammetry
