#pragma once

#include "videogrammetry/core/cpu.h"
#include "videogrammetry/core/image_view.h"
#include "videogrammetry/recognition/grey_window.h"
#include "videogrammetry/recognition/model_fit.h"

namespace videogrammetry {

/// What a sample of a picture's pixels says about its grey values.
struct GreyStatistics {
  int low = 0;              ///< 0.1 % quantile
  int high = 0;             ///< 99.9 % quantile
  int median_gradient = 0;  ///< median of |I(x+1) - I(x-1)|
};

/// Statistics of every n-th row, about 20 000 pixels in all.
template <typename T>
GreyStatistics MeasureGreyStatistics(const ImageView<T>& image);

/// The same of about 8000 pixels in short pieces all over a picture of any depth, in a
/// few microseconds; the same for every storage of the values and every set.
GreyStatistics SampleGreyStatistics(const FrameView& frame,
                                    InstructionSet set = DetectInstructionSet());

/// Threshold on |I(x+1) - I(x-1)| that separates edges from noise.
///
/// Four standard deviations of the difference where noise (or texture) fills
/// the picture: median / 0.6745 is the deviation of a normal distribution. At
/// least 2 % of the picture's range, where the noise is less than the
/// quantisation; at most 20 % of it, so that a picture full of texture does
/// not hide its targets.
int GradientThreshold(const GreyStatistics& statistics);

/// The search's threshold on |I(x+1) - I(x-1)|, that may grow with the brighter grey value I
/// (as it is stored, whatever the polarity):
///
///     least + min(most, max(0, I - from_grey) * per_grey / 65536), rounded down.      (1)
struct EdgeThreshold {
  int least = 3;
  int from_grey = 0, per_grey = 0, most = 0;  ///< 0 ... 65535

  EdgeThreshold() = default;
  EdgeThreshold(int same_for_all) : least(same_for_all) {}  // NOLINT: a threshold is a number
  bool Grows() const { return per_grey > 0 && most > 0; }
  int At(int grey) const;
};

/// A threshold that the noise does not reach where it is brighter: from where four
/// deviations of the difference, 4 sqrt(2 Var(I)), exceed the constant threshold T, the line
/// through T and the place where they are 2 T, up to 3 T: in bright clutter noise makes edges
/// by the ten thousand, and on bright dots it breaks chords.
///
/// @param noise  of grey values with the polarity's sign.
EdgeThreshold ThresholdByNoise(int least, const GreyNoise& noise, int sign);

}  // namespace videogrammetry
