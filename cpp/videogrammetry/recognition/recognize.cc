#include "videogrammetry/recognition/recognize.h"

#include "videogrammetry/core/thread_pool.h"
#include "videogrammetry/recognition/frame_recognition.h"

namespace videogrammetry {

std::vector<Target> Recognize(const FrameView& frame, const RecognitionOptions& options,
                              const CodeFamily& family) {
  family.Check();
  return RecognizeFrame(frame, options.Resolved(), family, nullptr, WholeFrame(frame), nullptr);
}

Recognizer::Recognizer(const RecognitionOptions& options, const CodeFamily& family)
    : options_(options.Resolved()), family_(family) {
  family_.Check();
}

std::vector<std::vector<Target>> Recognizer::RecognizeFrames(const std::vector<FrameView>& frames,
                                                             int num_threads,
                                                             const CameraModel* camera) const {
  std::vector<std::vector<Target>> targets(frames.size());
  ParallelFor(static_cast<int>(frames.size()), num_threads, [&](int i) {
    const auto slot = static_cast<std::size_t>(i);
    const FrameView& frame = frames[slot];
    targets[slot] = RecognizeFrame(frame, options_, family_, camera, WholeFrame(frame), nullptr);
  });
  return targets;
}

std::optional<CameraModel> Recognizer::Learn(const FrameView& frame) const {
  std::optional<CameraModel> learned;
  if (options_.method == kEdgePair) {
    RecognizeFrame(frame, options_, family_, nullptr, WholeFrame(frame), &learned);
  }
  return learned;
}

}  // namespace videogrammetry
