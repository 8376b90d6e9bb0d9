#include "videogrammetry/recognition/recognize.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <type_traits>

#include "videogrammetry/core/thread_pool.h"
#include "videogrammetry/recognition/candidate_search.h"
#include "videogrammetry/recognition/dual_conic.h"
#include "videogrammetry/recognition/ellipse_fit.h"
#include "videogrammetry/recognition/gradient_threshold.h"
#include "videogrammetry/recognition/model_pool.h"

namespace videogrammetry {
namespace {

/// A reading this much better than another of the same ID is the true one.
constexpr double kClearlyBetter = 0.25;

bool SamePlace(const Ellipse& a, const Ellipse& b) {
  const double reach = 0.5 * std::min(a.semi_minor_px, b.semi_minor_px);
  return std::hypot(a.x_px - b.x_px, a.y_px - b.y_px) < reach;
}

/// True for a candidate measured before (found again at another grey level).
bool IsKnown(const Ellipse& candidate, const std::vector<Target>& targets) {
  return std::any_of(targets.begin(), targets.end(),
                     [&](const Target& known) { return SamePlace(known.edge.ellipse, candidate); });
}

bool HasRing(const Target& target) {
  return target.ring.status == RingStatus::kCoded || target.ring.status == RingStatus::kMirrored ||
         target.ring.status == RingStatus::kNotInTable ||
         target.ring.status == RingStatus::kEdgesOff;
}

/// Leaves out what lies in another target's ring and is smaller than its dot.
void RemoveRingPieces(const CodeFamily& family, std::vector<Target>* targets) {
  std::vector<char> piece(targets->size(), 0);
  for (const Target& owner : *targets) {
    if (!HasRing(owner)) continue;
    const EllipseFrame frame = EllipseFrame::From(owner.edge.ellipse);
    const Eigen::Matrix2d inverse = frame.shape.inverse();
    for (std::size_t i = 0; i < targets->size(); ++i) {
      const Ellipse& e = (*targets)[i].edge.ellipse;
      const double radius = (inverse * (Eigen::Vector2d(e.x_px, e.y_px) - frame.center)).norm();
      piece[i] |= radius > 1.0 && radius < family.ring_outer + 0.2 &&
                  e.semi_minor_px < owner.edge.ellipse.semi_minor_px;
    }
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < targets->size(); ++i) {
    if (!piece[i]) (*targets)[kept++] = (*targets)[i];
  }
  targets->resize(kept);
}

// An ID that stands at several places of one picture: a reading clearly worse
// than the best is taken for wrong; equally clear rings keep the ID that they
// show, marked, because which of two stickers is meant is not for one picture
// to say.
void ResolveDuplicates(std::vector<Target>* targets) {
  std::map<int, std::vector<Target*>> places;
  for (Target& target : *targets) {
    if (target.ring.id) places[*target.ring.id].push_back(&target);
  }
  for (auto& [id, same] : places) {
    if (same.size() < 2) continue;
    std::sort(same.begin(), same.end(),
              [](const Target* a, const Target* b) { return a->ring.quality > b->ring.quality; });
    const bool first_is_true = same[0]->ring.quality > same[1]->ring.quality + kClearlyBetter;
    for (std::size_t i = first_is_true ? 1 : 0; i < same.size(); ++i) {
      if (first_is_true) same[i]->ring.id.reset();
      same[i]->ring.status = RingStatus::kDuplicate;
    }
  }
}

/// Recognize() with options and a family that have been checked.
template <typename T>
std::vector<Target> RecognizeChecked(const ImageView<T>& image, const RecognitionOptions& options,
                                     const CodeFamily& family) {
  const SignedImage<T> picture(image, options.polarity == Polarity::kWhiteOnBlack ? 1 : -1);
  const int threshold = GradientThreshold(MeasureGreyStatistics(image));
  std::vector<Target> targets;
  for (const Candidate& candidate : FindCandidates(picture, options, threshold)) {
    if (IsKnown(candidate.ellipse, targets)) continue;
    const auto edge = MeasureTargetEdge(picture, candidate, options);
    if (edge && !IsKnown(edge->ellipse, targets)) targets.push_back({*edge, {}});
  }
  if (family.num_bits > 0) {
    WindowReader reader(image, picture.sign());
    for (Target& target : targets) {
      const GreyWindow window = ReadRingWindow(target.edge, family, &reader);
      target.ring = ReadRing(window, target.edge, family, options.direction);
    }
    RemoveRingPieces(family, &targets);
    ResolveDuplicates(&targets);
  }
  std::vector<TargetEdge*> edges;
  for (Target& target : targets) edges.push_back(&target.edge);
  if (options.estimator == Estimator::kModel) RefineByModel(picture, edges);
  if (options.estimator == Estimator::kDualConic) RefineByDualConic(image, picture.sign(), edges);
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
                                   const CodeFamily& family) {
  return std::visit(
      [&](const auto& image) {
        if constexpr (std::is_same_v<std::decay_t<decltype(image)>, Packed12View>) {
          const std::vector<std::uint16_t> samples = Unpacked(image);
          const ImageView16 view(samples.data(), image.width(), image.height());
          return RecognizeChecked(view, options, family);
        } else {
          return RecognizeChecked(image, options, family);
        }
      },
      frame);
}

}  // namespace

std::vector<Target> Recognize(const FrameView& frame, const RecognitionOptions& options,
                              const CodeFamily& family) {
  options.Check();
  family.Check();
  return RecognizeFrame(frame, options, family);
}

Recognizer::Recognizer(const RecognitionOptions& options, const CodeFamily& family)
    : options_(options), family_(family) {
  options_.Check();
  family_.Check();
}

std::vector<std::vector<Target>> Recognizer::RecognizeFrames(const std::vector<FrameView>& frames,
                                                             int num_threads) const {
  std::vector<std::vector<Target>> targets(frames.size());
  ParallelFor(static_cast<int>(frames.size()), num_threads, [&](int i) {
    const auto slot = static_cast<std::size_t>(i);
    targets[slot] = RecognizeFrame(frames[slot], options_, family_);
  });
  return targets;
}

}  // namespace videogrammetry
