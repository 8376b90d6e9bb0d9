#pragma once

#include <optional>
#include <vector>

#include "videogrammetry/core/image_view.h"
#include "videogrammetry/recognition/camera_model.h"
#include "videogrammetry/recognition/code_family.h"
#include "videogrammetry/recognition/grey_window.h"
#include "videogrammetry/recognition/options.h"
#include "videogrammetry/recognition/target.h"

namespace videogrammetry {

/// Recognises the targets of one picture.
///
/// options.method "edge-pair": search (edge_pair_search.h) -> blurred ellipse
/// (edge_pair_recognition.h) -> ring (ring_code.h). "local-canny", the paper's way:
/// search (gradient_threshold.h, candidate_search.h) -> edge (local_canny.h,
/// edge_points.h) -> ellipse (ellipse_fit.h, target_edge.h) -> ring. A target that
/// lies inside another one's ring is a piece of that ring and left out; an ID that
/// stands at several places is taken from all of them unless one agrees far better.
/// With another estimator than the method's own, what is left is measured anew.
///
/// @param family  the codes; options.codes is not looked at.
/// @return targets in the order of the rows, then of the columns, of their first chord.
/// @throws std::invalid_argument if the options or the family are not valid.
std::vector<Target> Recognize(const FrameView& frame, const RecognitionOptions& options,
                              const CodeFamily& family);

/// Options and codes for many pictures, checked once: of the largest family that
/// alone takes longer than a small picture.
class Recognizer {
 public:
  /// @throws std::invalid_argument if the options or the family are not valid.
  Recognizer(const RecognitionOptions& options, const CodeFamily& family);

  /// Recognises the targets of several pictures, on up to `num_threads` threads.
  ///
  /// Equal to Recognize() of each one, whatever the number of threads. Sizes and
  /// depths of the pictures may differ. Several threads may call it at once.
  ///
  /// @param num_threads  0: one a core.
  /// @param camera  of all pictures, see Learn; nullptr: each picture says for itself.
  /// @return the targets of every picture, in the pictures' order.
  /// @throws std::invalid_argument if num_threads < 0.
  std::vector<std::vector<Target>> RecognizeFrames(const std::vector<FrameView>& frames,
                                                   int num_threads,
                                                   const CameraModel* camera = nullptr) const;

  /// What the fast way learns of a camera from one of its pictures; nullopt if that has
  /// no targets, or for the paper's way.
  std::optional<CameraModel> Learn(const FrameView& frame) const;

 private:
  RecognitionOptions options_;
  CodeFamily family_;
};

}  // namespace videogrammetry
