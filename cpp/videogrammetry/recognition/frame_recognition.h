#pragma once

// Private to the room: one frame by options and a family that have been checked.

#include <optional>
#include <vector>

#include "videogrammetry/recognition/camera_model.h"
#include "videogrammetry/recognition/code_family.h"
#include "videogrammetry/recognition/edge_pair_recognition.h"
#include "videogrammetry/recognition/edge_pair_search.h"
#include "videogrammetry/recognition/grey_window.h"
#include "videogrammetry/recognition/options.h"
#include "videogrammetry/recognition/target.h"

namespace videogrammetry {

std::vector<SearchWindow> WholeFrame(const FrameView& frame);

/// Recognises the targets of a frame, or of parts of it by the method kEdgePair.
///
/// @param camera  nullptr: the frame says for itself.
/// @param learned  receives what the frame says of the camera, if it is not null.
std::vector<Target> RecognizeFrame(const FrameView& frame, const RecognitionOptions& options,
                                   const CodeFamily& family, const CameraModel* camera,
                                   const std::vector<SearchWindow>& windows,
                                   std::optional<CameraModel>* learned);

/// What is done with a frame beyond where targets are expected.
enum class Elsewhere { kLeftOut, kSearched };

/// Recognises the targets of a frame by the method kEdgePair where they are expected.
///
/// What FitModel's fast fit measures (the estimator kModel) needs no search. For all other
/// estimators, and for a dot that is not found so, its window is searched.
///
/// @param windows  one a dot.
std::vector<Target> RecognizeExpected(const FrameView& frame, const RecognitionOptions& options,
                                      const CodeFamily& family, const CameraModel& camera,
                                      const std::vector<ExpectedDot>& dots,
                                      const std::vector<SearchWindow>& windows,
                                      Elsewhere elsewhere);

}  // namespace videogrammetry
