#pragma once

#include <vector>

#include "videogrammetry/adjustment/resection.h"

namespace videogrammetry {

/// One picture's points with known coordinates.
struct ResectionView {
  Points3d points_mm;
  Points2d pixels;
};

struct FocalSearchResult {
  double f_px = 0.0;
  double rms_px = 0.0;  ///< robust: of min(distance, threshold), per point
  /// Pooled cost at half and at twice f over the cost at f: near 1 means that
  /// the pictures say little about f.
  double contrast = 0.0;
};

/// Principal distance of a camera without start values.
///
/// At what DLT and Zhang's conditions give, where they give something, and, unless one of
/// these leaves less than a tenth of the threshold, on a grid from 0.4 to 40 times the
/// picture's larger side, every picture is resected and the pooled robust residual judged;
/// the best f is refined by golden section with all poses refined along. Distortion is taken from
/// `camera` as it stands; `camera`'s f is ignored.
///
/// @throws AdjustmentError if no picture can be resected at any f.
FocalSearchResult SearchFocal(const Camera& camera, const std::vector<ResectionView>& views,
                              double threshold_px);

}  // namespace videogrammetry
