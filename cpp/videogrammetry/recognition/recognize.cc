#include "videogrammetry/recognition/recognize.h"

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <type_traits>

#include "videogrammetry/core/thread_pool.h"
#include "videogrammetry/recognition/candidate_search.h"
#include "videogrammetry/recognition/dual_conic.h"
#include "videogrammetry/recognition/edge_pair_recognition.h"
#include "videogrammetry/recognition/edge_pair_search.h"
#include "videogrammetry/recognition/gradient_threshold.h"
#include "videogrammetry/recognition/model_pool.h"
#include "videogrammetry/recognition/target_selection.h"

namespace videogrammetry {
namespace {

/// Reads the rings of targets from `first` on.
void ReadRings(const FrameView& frame, int sign, const CodeFamily& family,
               ReadingDirection direction, std::vector<Target>* targets, std::size_t first = 0) {
  if (family.num_bits == 0) return;
  WindowReader reader(frame, sign);
  for (std::size_t i = first; i < targets->size(); ++i) {
    Target& target = (*targets)[i];
    const GreyWindow window = ReadRingWindow(target.edge, family, &reader);
    target.ring = ReadRing(window, target.edge, family, direction);
  }
}

void SelectByRings(const CodeFamily& family, std::vector<Target>* targets) {
  if (family.num_bits == 0) return;
  RemoveRingPieces(family, targets);
  ResolveDuplicates(targets);
}

std::vector<TargetEdge*> EdgesOf(std::vector<Target>* targets) {
  std::vector<TargetEdge*> edges;
  for (Target& target : *targets) edges.push_back(&target.edge);
  return edges;
}

/// The paper's way, on options and a family that have been checked.
template <typename T>
std::vector<Target> RecognizeByLocalCanny(const ImageView<T>& image,
                                          const RecognitionOptions& options,
                                          const CodeFamily& family) {
  const int sign = options.polarity == Polarity::kWhiteOnBlack ? 1 : -1;
  const SignedImage<T> picture(image, sign);
  const int threshold = GradientThreshold(MeasureGreyStatistics(image));
  std::vector<Target> targets;
  PlaceIndex index;
  for (const Candidate& candidate : FindCandidates(picture, options, threshold)) {
    if (IsKnown(candidate.ellipse, targets, index)) continue;
    const auto edge = MeasureTargetEdge(picture, candidate, options);
    if (!edge || IsKnown(edge->ellipse, targets, index)) continue;
    index.Insert(edge->ellipse.x_px, edge->ellipse.y_px, static_cast<int>(targets.size()));
    targets.push_back({*edge, {}});
  }
  ReadRings(image, sign, family, options.direction, &targets);
  SelectByRings(family, &targets);
  if (options.estimator == Estimator::kModel) RefineByModel(picture, EdgesOf(&targets));
  return targets;
}

/// Appends dots that are not known yet.
void Append(const std::vector<DotMeasurement>& dots, PlaceIndex* index,
            std::vector<Target>* targets, std::vector<int>* regions) {
  for (const DotMeasurement& dot : dots) {
    const Ellipse& e = dot.edge.ellipse;
    if (IsKnown(e, *targets, *index)) continue;
    index->Insert(e.x_px, e.y_px, static_cast<int>(targets->size()));
    targets->push_back({dot.edge, {}});
    regions->push_back(dot.region);
  }
}

/// The targets in the order of their areas.
std::vector<Target> InOrder(const std::vector<Target>& targets, const std::vector<int>& regions) {
  std::vector<std::size_t> order(targets.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return regions[a] < regions[b]; });
  std::vector<Target> sorted;
  sorted.reserve(targets.size());
  for (const std::size_t i : order) sorted.push_back(targets[i]);
  return sorted;
}

/// The fast way. What it learned of the camera goes to `learned`, if that is not null.
std::vector<Target> RecognizeByEdgePairs(const FrameView& frame, const RecognitionOptions& options,
                                         const CodeFamily& family, const CameraModel* camera,
                                         std::optional<CameraModel>* learned) {
  const int sign = options.polarity == Polarity::kWhiteOnBlack ? 1 : -1;
  EdgePairRecognition recognition(frame, options);
  const int threshold =
      camera ? camera->gradient_threshold : GradientThreshold(SampleGreyStatistics(frame));
  const auto areas = FindDotRegions(frame, sign, options.diameter_px, threshold);
  std::vector<Target> targets;
  std::vector<int> regions;
  PlaceIndex index;
  Append(recognition.MeasureClear(areas, camera), &index, &targets, &regions);
  ReadRings(frame, sign, family, options.direction, &targets);
  // Sectors of rings that have been read need no second look.
  const RingPlaces rings(family, targets);
  const std::size_t clear = targets.size();
  Append(recognition.MeasureUnclear(
             [&](const Ellipse& dot) { return rings.Holds(dot) || IsKnown(dot, targets, index); }),
         &index, &targets, &regions);
  ReadRings(frame, sign, family, options.direction, &targets, clear);
  targets = InOrder(targets, regions);
  SelectByRings(family, &targets);
  if (learned && recognition.picture()) *learned = CameraModel{threshold, *recognition.picture()};
  return targets;
}

std::vector<std::uint16_t> Unpacked(const Packed12View& image) {
  std::vector<std::uint16_t> samples;
  samples.reserve(static_cast<std::size_t>(image.width()) *
                  static_cast<std::size_t>(image.height()));
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      samples.push_back(static_cast<std::uint16_t>(image(x, y)));
    }
  }
  return samples;
}

std::vector<Target> RecognizeFrame(const FrameView& frame, const RecognitionOptions& options,
                                   const CodeFamily& family, const CameraModel* camera,
                                   std::optional<CameraModel>* learned = nullptr) {
  std::vector<Target> targets;
  if (options.method == kEdgePair) {
    targets = RecognizeByEdgePairs(frame, options, family, camera, learned);
  } else {
    targets = std::visit(
        [&](const auto& image) {
          if constexpr (std::is_same_v<std::decay_t<decltype(image)>, Packed12View>) {
            const std::vector<std::uint16_t> samples = Unpacked(image);
            const ImageView16 view(samples.data(), image.width(), image.height());
            return RecognizeByLocalCanny(view, options, family);
          } else {
            return RecognizeByLocalCanny(image, options, family);
          }
        },
        frame);
  }
  if (options.estimator == Estimator::kDualConic) {
    RefineByDualConic(frame, options.polarity == Polarity::kWhiteOnBlack ? 1 : -1,
                      EdgesOf(&targets));
  }
  return targets;
}

}  // namespace

std::vector<Target> Recognize(const FrameView& frame, const RecognitionOptions& options,
                              const CodeFamily& family) {
  options.Check();
  family.Check();
  return RecognizeFrame(frame, options, family, nullptr);
}

Recognizer::Recognizer(const RecognitionOptions& options, const CodeFamily& family)
    : options_(options), family_(family) {
  options_.Check();
  family_.Check();
}

std::vector<std::vector<Target>> Recognizer::RecognizeFrames(const std::vector<FrameView>& frames,
                                                             int num_threads,
                                                             const CameraModel* camera) const {
  std::vector<std::vector<Target>> targets(frames.size());
  ParallelFor(static_cast<int>(frames.size()), num_threads, [&](int i) {
    const auto slot = static_cast<std::size_t>(i);
    targets[slot] = RecognizeFrame(frames[slot], options_, family_, camera);
  });
  return targets;
}

std::optional<CameraModel> Recognizer::Learn(const FrameView& frame) const {
  std::optional<CameraModel> learned;
  if (options_.method == kEdgePair) RecognizeFrame(frame, options_, family_, nullptr, &learned);
  return learned;
}

}  // namespace videogrammetry
