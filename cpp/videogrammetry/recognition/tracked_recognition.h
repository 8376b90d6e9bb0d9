#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "videogrammetry/recognition/edge_pair_recognition.h"
#include "videogrammetry/recognition/edge_pair_search.h"
#include "videogrammetry/recognition/recognize.h"

namespace videogrammetry {

/// How targets are followed from frame to frame.
struct TrackedOptions {
  /// Every so many frames the whole frame is searched, for what is new; 1: always. What is
  /// known is followed there too, and found anew at the first of these after 100 frames.
  int full_every = 100;
  /// How far a target may be from where it is expected, pixels; 1 ... 1000.
  double margin_px = 4.0;

  /// @throws std::invalid_argument naming the field, what was expected and what was given.
  void Check() const;
};

/// What was done with a frame.
struct TrackedFrame {
  std::vector<Target> targets;  ///< in the order of their centres' y, then x
  bool full = false;            ///< the whole frame was searched
  int lost = 0;                 ///< targets that were expected and not found
};

/// Recognises the frames of one camera one after the other, looking where targets are
/// expected.
///
/// A target is expected where it would be if it went on as between the last two frames.
/// With the estimator "model" it is measured from there by the fits of the whole frame's search,
/// clear dots by the fast one and unclear ones by FitModel, so that it is the one which that gives
/// but for where the two fits begin: they use other pixels of the plateaus and end a little apart,
/// a twentieth of its sigma as a rule, seldom more than a quarter. A target that is not found so,
/// and with other estimators all of them, is searched for in a window around its place by the rule
/// of the whole frame's search: bit for bit the same, unless clutter that reaches into the window
/// lets the search begin at another chord of the dot. Where a target is not found, a window three
/// times as wide is searched; if it is not there either, the whole frame is, and so is one after a
/// frame without targets. Every `full_every`-th frame is searched beside the targets that are
/// followed, and the first of these after a hundred frames as if nothing were known. A ring that
/// was read before is looked at in every frame whether it is still the same (FollowRing), all
/// others are read as in a whole search. Method "edge-pair" alone.
class TrackedRecognizer {
 public:
  /// @param camera  learned from the first frame with targets if it is not given.
  /// @throws std::invalid_argument if options or family are not valid, or the method is not
  ///     kEdgePair.
  TrackedRecognizer(const RecognitionOptions& options, const CodeFamily& family,
                    const TrackedOptions& tracked, std::optional<CameraModel> camera);

  TrackedFrame Next(const FrameView& frame);

  /// The camera's model, once known.
  const std::optional<CameraModel>& camera() const { return camera_; }

 private:
  /// Where a target was, and how it moved to there.
  struct Track {
    ExpectedDot dot;
    double step_x = 0.0, step_y = 0.0;

    double expected_x() const { return dot.edge.ellipse.x_px + step_x; }
    double expected_y() const { return dot.edge.ellipse.y_px + step_y; }
  };

  std::vector<Target> SearchWhole(const FrameView& frame);
  std::vector<Target> SearchExpected(const FrameView& frame,
                                     const std::vector<SearchWindow>& windows, bool whole) const;
  SearchWindow WindowAround(const Track& track, double margin_px) const;
  std::vector<int> Follow(const std::vector<Target>& targets, int width, int height,
                          std::vector<Track>* next) const;

  RecognitionOptions options_;
  CodeFamily family_;
  TrackedOptions tracked_;
  std::optional<CameraModel> camera_;
  std::vector<Track> tracks_;
  std::int64_t frame_ = 0, found_anew_ = 0;  ///< the next one, and the last without followed ones
};

}  // namespace videogrammetry
