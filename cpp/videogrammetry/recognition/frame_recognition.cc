#include "videogrammetry/recognition/frame_recognition.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <type_traits>

#include "videogrammetry/recognition/candidate_search.h"
#include "videogrammetry/recognition/dual_conic.h"
#include "videogrammetry/recognition/edge_pair_recognition.h"
#include "videogrammetry/recognition/edge_pair_search.h"
#include "videogrammetry/recognition/gradient_threshold.h"
#include "videogrammetry/recognition/model_pool.h"
#include "videogrammetry/recognition/target_selection.h"

namespace videogrammetry {
namespace {

void ReadRings(const FrameView& frame, int sign, const CodeFamily& family,
               ReadingDirection direction, std::vector<Target>* targets) {
  if (family.num_bits == 0) return;
  const GreySampler picture(frame, sign);
  for (Target& target : *targets) {
    target.ring = ReadRing(picture, target.edge, family, direction);
  }
}

void SelectByRings(const CodeFamily& family, const FrameView& frame, std::vector<Target>* targets) {
  if (family.num_bits == 0) return;
  RemoveRingPieces(family, FrameWidth(frame), FrameHeight(frame), targets);
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
  PlaceIndex index(image.width(), image.height());
  for (const Candidate& candidate : FindCandidates(picture, options, threshold)) {
    if (IsKnown(candidate.ellipse, targets, index)) continue;
    const auto edge = MeasureTargetEdge(picture, candidate, options);
    if (!edge || IsKnown(edge->ellipse, targets, index)) continue;
    index.Insert(edge->ellipse.x_px, edge->ellipse.y_px, static_cast<int>(targets.size()));
    targets.push_back({*edge, {}});
  }
  ReadRings(image, sign, family, options.direction, &targets);
  SelectByRings(family, image, &targets);
  if (options.estimator == Estimator::kModel) RefineByModel(picture, EdgesOf(&targets));
  return targets;
}

/// The second search's threshold over the first one's, and the third's over the second's. On
/// fewer rows, for larger dots alone, they lost some whose few chords were broken all the same.
constexpr int kHigherThreshold = 3;
/// Adds areas that a search at higher thresholds finds: a chord ends at the nearest edge
/// beyond the threshold, so noise, texture, compression or a gleam inside a dot of high
/// contrast breaks its chords where the threshold follows faint edges.
void AddAreas(const FrameView& frame, const RecognitionOptions& options,
              std::initializer_list<int> thresholds, const std::vector<SearchWindow>& windows,
              const KnownParts* known, std::vector<DotRegion>* areas) {
  const int sign = options.polarity == Polarity::kWhiteOnBlack ? 1 : -1;
  PlaceIndex index(FrameWidth(frame), FrameHeight(frame));
  const auto enter = [&](std::size_t i) {
    const ContourMoments& m = (*areas)[i].moments;
    index.Insert(m.mean_x, m.mean_y, static_cast<int>(i));
  };
  for (std::size_t i = 0; i < areas->size(); ++i) enter(i);
  for (const int higher : thresholds) {
    for (const DotRegion& area :
         FindDotRegions(frame, sign, options.diameter_px, higher, windows, known)) {
      const ContourMoments& m = area.moments;
      // The very same one: another level may make a dot of what was none.
      const bool is_there = index.AnyNear(m.mean_x, m.mean_y, 0.1, [&](int number) {
        const double other = (*areas)[static_cast<std::size_t>(number)].moments.area;
        return std::abs(m.area - other) < 0.01 * other;
      });
      if (is_there) continue;
      areas->push_back(area);
      enter(areas->size() - 1);
    }
  }
}

/// Each finds some that the others do not: where its threshold meets the texture's steps.
void AddTexturedAreas(const FrameView& frame, const RecognitionOptions& options, int threshold,
                      const std::vector<SearchWindow>& windows, const KnownParts* known,
                      std::vector<DotRegion>* areas) {
  AddAreas(frame, options, {threshold, kHigherThreshold * threshold}, windows, known, areas);
}

/// The search's threshold by a camera's model. (What hides in its noise where dots are
/// textured is no noise.)
EdgeThreshold ThresholdOf(const CameraModel& camera, int sign) {
  if (camera.second_threshold != 0) return camera.gradient_threshold;
  return ThresholdByNoise(camera.gradient_threshold, camera.picture.noise, sign);
}

/// The areas that may be dots, by a camera's model.
std::vector<DotRegion> FindAreas(const FrameView& frame, const RecognitionOptions& options,
                                 const CameraModel& camera,
                                 const std::vector<SearchWindow>& windows,
                                 const KnownParts* known = nullptr) {
  const int sign = options.polarity == Polarity::kWhiteOnBlack ? 1 : -1;
  const EdgeThreshold threshold = ThresholdOf(camera, sign);
  auto areas = FindDotRegions(frame, sign, options.diameter_px, threshold, windows, known);
  if (camera.second_threshold != 0) {
    AddTexturedAreas(frame, options, camera.second_threshold, windows, known, &areas);
  }
  return areas;
}

/// The fast way, in parts of the picture. What it learned of the camera goes to `learned`,
/// if that is not null.
std::vector<Target> RecognizeByEdgePairs(const FrameView& frame, const RecognitionOptions& options,
                                         const CodeFamily& family, const CameraModel* camera,
                                         const std::vector<SearchWindow>& windows,
                                         std::optional<CameraModel>* learned) {
  if (FrameWidth(frame) < 3 || FrameHeight(frame) < 3) return {};
  const int sign = options.polarity == Polarity::kWhiteOnBlack ? 1 : -1;
  const int threshold =
      camera ? camera->gradient_threshold : GradientThreshold(SampleGreyStatistics(frame));
  EdgePairRecognition recognition(frame, options, family, threshold);
  std::vector<DotRegion> areas;
  int second = 0;
  if (camera) {
    second = camera->second_threshold;
    recognition.SetPicture(camera->picture);
    areas = FindAreas(frame, options, *camera, windows);
  } else {
    areas = FindDotRegions(frame, sign, options.diameter_px, threshold, windows);
    recognition.Learn(areas);
    if (!recognition.picture() || recognition.inside() == DotInside::kTextured) {
      second = kHigherThreshold * threshold;
      AddTexturedAreas(frame, options, second, windows, nullptr, &areas);
    } else if (recognition.inside() == DotInside::kNoisy) {
      AddAreas(frame, options, {recognition.inside_threshold()}, windows, nullptr, &areas);
    }
    if (!recognition.picture()) recognition.Learn(areas);
  }
  std::vector<Target> targets = recognition.Measure(areas);
  SelectByRings(family, frame, &targets);
  if (learned && recognition.picture()) {
    *learned = CameraModel{threshold, second, *recognition.picture()};
  }
  return targets;
}

/// Measures the targets anew if the estimator is not one of the methods' own.
void Refine(const FrameView& frame, const RecognitionOptions& options,
            std::vector<Target>* targets) {
  if (options.estimator != Estimator::kDualConic) return;
  RefineByDualConic(frame, options.polarity == Polarity::kWhiteOnBlack ? 1 : -1, EdgesOf(targets));
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

}  // namespace

std::vector<SearchWindow> WholeFrame(const FrameView& frame) {
  return {{0, 0, FrameWidth(frame) - 1, FrameHeight(frame) - 1}};
}

std::vector<Target> RecognizeFrame(const FrameView& frame, const RecognitionOptions& options,
                                   const CodeFamily& family, const CameraModel* camera,
                                   const std::vector<SearchWindow>& windows,
                                   std::optional<CameraModel>* learned) {
  std::vector<Target> targets;
  if (options.method == kEdgePair) {
    targets = RecognizeByEdgePairs(frame, options, family, camera, windows, learned);
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
  Refine(frame, options, &targets);
  return targets;
}

std::vector<Target> RecognizeExpected(const FrameView& frame, const RecognitionOptions& options,
                                      const CodeFamily& family, const CameraModel& camera,
                                      const std::vector<ExpectedDot>& dots,
                                      const std::vector<SearchWindow>& windows,
                                      Elsewhere elsewhere) {
  const bool whole = elsewhere == Elsewhere::kSearched;
  if (options.estimator != Estimator::kModel || FrameWidth(frame) < 3 || FrameHeight(frame) < 3) {
    const auto& parts = whole ? WholeFrame(frame) : windows;
    return RecognizeFrame(frame, options, family, &camera, parts, nullptr);
  }
  EdgePairRecognition recognition(frame, options, family, camera.gradient_threshold);
  recognition.SetPicture(camera.picture);
  std::vector<SearchWindow> left;
  for (const int i : recognition.MeasureExpected(dots)) {
    left.push_back(windows[static_cast<std::size_t>(i)]);
  }
  std::vector<DotRegion> areas;
  if (whole) {
    const KnownParts known = recognition.MeasuredParts();
    areas = FindAreas(frame, options, camera, WholeFrame(frame), &known);
  } else if (!left.empty()) {
    areas = FindAreas(frame, options, camera, left);
  }
  std::vector<Target> targets = recognition.Measure(areas);
  SelectByRings(family, frame, &targets);
  return targets;
}

}  // namespace videogrammetry
