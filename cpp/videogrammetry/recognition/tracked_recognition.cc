#include "videogrammetry/recognition/tracked_recognition.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "videogrammetry/recognition/frame_recognition.h"
#include "videogrammetry/recognition/place_index.h"

namespace videogrammetry {
namespace {

/// What a window holds beside the dot and the margin: its edge and the ground.
constexpr double kGroundPx = 5.0;
/// How much wider the window of a target is that was not found in its own.
constexpr double kWider = 3.0;
/// Frames after which the whole one is searched as if nothing were known.
constexpr std::int64_t kFoundAnewEvery = 100;

}  // namespace

void TrackedOptions::Check() const {
  if (full_every < 1) {
    throw std::invalid_argument("full_every: expected 1 or more, got " +
                                std::to_string(full_every));
  }
  if (!(margin_px >= 1.0) || !(margin_px <= 1000.0)) {
    throw std::invalid_argument("margin_px: expected 1 ... 1000, got " + std::to_string(margin_px));
  }
}

TrackedRecognizer::TrackedRecognizer(const RecognitionOptions& options, const CodeFamily& family,
                                     const TrackedOptions& tracked,
                                     std::optional<CameraModel> camera)
    : options_(options.Resolved()), family_(family), tracked_(tracked), camera_(std::move(camera)) {
  family_.Check();
  tracked_.Check();
  if (options_.method != kEdgePair) {
    throw std::invalid_argument("method: targets are followed by 'edge-pair' alone, got '" +
                                options_.method + "'");
  }
}

std::vector<Target> TrackedRecognizer::SearchWhole(const FrameView& frame) {
  if (!camera_) {
    // The first frame too is measured by the rule of all others.
    auto alone = RecognizeFrame(frame, options_, family_, nullptr, WholeFrame(frame), &camera_);
    if (!camera_) return alone;
  }
  return RecognizeFrame(frame, options_, family_, &*camera_, WholeFrame(frame), nullptr);
}

std::vector<Target> TrackedRecognizer::SearchExpected(const FrameView& frame,
                                                      const std::vector<SearchWindow>& windows,
                                                      bool whole) const {
  std::vector<ExpectedDot> dots;
  for (const Track& track : tracks_) {
    dots.push_back(track.dot);
    dots.back().edge.ellipse.x_px = track.expected_x();
    dots.back().edge.ellipse.y_px = track.expected_y();
  }
  return RecognizeExpected(frame, options_, family_, *camera_, dots, windows,
                           whole ? Elsewhere::kSearched : Elsewhere::kLeftOut);
}

SearchWindow TrackedRecognizer::WindowAround(const Track& track, double margin_px) const {
  const double reach = track.dot.edge.ellipse.semi_major_px + margin_px + kGroundPx;
  return {static_cast<int>(std::floor(track.expected_x() - reach)),
          static_cast<int>(std::floor(track.expected_y() - reach)),
          static_cast<int>(std::ceil(track.expected_x() + reach)),
          static_cast<int>(std::ceil(track.expected_y() + reach))};
}

// Gives every track the nearest target like it; returns those that have none.
std::vector<int> TrackedRecognizer::Follow(const std::vector<Target>& targets, int width,
                                           int height, std::vector<Track>* next) const {
  PlaceIndex index(width, height);
  next->clear();
  for (std::size_t i = 0; i < targets.size(); ++i) {
    const TargetEdge& edge = targets[i].edge;
    index.Insert(edge.ellipse.x_px, edge.ellipse.y_px, static_cast<int>(i));
    next->push_back({{edge, targets[i].ring}, 0.0, 0.0});
  }
  std::vector<int> lost;
  for (std::size_t k = 0; k < tracks_.size(); ++k) {
    const Track& track = tracks_[k];
    const double reach = kWider * tracked_.margin_px;
    int nearest = -1;
    double least = reach;
    index.AnyNear(track.expected_x(), track.expected_y(), reach, [&](int i) {
      const Ellipse& e = targets[static_cast<std::size_t>(i)].edge.ellipse;
      const double distance = std::hypot(e.x_px - track.expected_x(), e.y_px - track.expected_y());
      if (distance < least && track.dot.IsLike(e)) {
        least = distance;
        nearest = i;
      }
      return false;
    });
    if (nearest < 0) {
      lost.push_back(static_cast<int>(k));
      continue;
    }
    Track& moved = (*next)[static_cast<std::size_t>(nearest)];
    moved.step_x = moved.dot.edge.ellipse.x_px - track.dot.edge.ellipse.x_px;
    moved.step_y = moved.dot.edge.ellipse.y_px - track.dot.edge.ellipse.y_px;
  }
  return lost;
}

TrackedFrame TrackedRecognizer::Next(const FrameView& frame) {
  TrackedFrame result;
  const int width = FrameWidth(frame), height = FrameHeight(frame);
  std::vector<Track> next;
  std::vector<int> lost;
  const auto search_whole = [&] {
    result.full = true;
    found_anew_ = frame_;
    result.targets = SearchWhole(frame);
    lost = Follow(result.targets, width, height, &next);
  };
  result.full = !camera_ || tracks_.empty() || frame_ % tracked_.full_every == 0;
  const bool anew = !camera_ || tracks_.empty() || frame_ - found_anew_ >= kFoundAnewEvery;
  if (result.full && anew) {
    search_whole();
  } else {
    std::vector<SearchWindow> windows;
    for (const Track& track : tracks_) windows.push_back(WindowAround(track, tracked_.margin_px));
    result.targets = SearchExpected(frame, windows, result.full);
    lost = Follow(result.targets, width, height, &next);
    if (!lost.empty() && !result.full) {
      for (const int k : lost) {
        windows[static_cast<std::size_t>(k)] =
            WindowAround(tracks_[static_cast<std::size_t>(k)], kWider * tracked_.margin_px);
      }
      result.targets = SearchExpected(frame, windows, false);
      lost = Follow(result.targets, width, height, &next);
    }
    // It may be anywhere, and others with it: everything has moved, or another scene began.
    // What a whole search does not find is gone, and looked for again when its turn comes.
    if (!lost.empty()) search_whole();
  }
  ++frame_;
  result.lost = static_cast<int>(lost.size());
  tracks_ = std::move(next);
  return result;
}

}  // namespace videogrammetry
