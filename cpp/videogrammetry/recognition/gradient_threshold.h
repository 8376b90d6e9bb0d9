#pragma once

#include "videogrammetry/core/cpu.h"
#include "videogrammetry/core/image_view.h"
#include "videogrammetry/recognition/grey_window.h"

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

}  // namespace videogrammetry
