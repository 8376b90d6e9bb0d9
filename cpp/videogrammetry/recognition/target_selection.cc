#include "videogrammetry/recognition/target_selection.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>

#include "videogrammetry/recognition/ellipse_fit.h"

namespace videogrammetry {
namespace {

/// A reading this much better than another of the same ID is the true one.
constexpr double kClearlyBetter = 0.25;
/// What a piece of a ring may reach beyond it, in radii of the dot.
constexpr double kBeyondRing = 0.2;

bool HasRing(const Target& target) {
  return target.ring.status == RingStatus::kCoded || target.ring.status == RingStatus::kMirrored ||
         target.ring.status == RingStatus::kNotInTable ||
         target.ring.status == RingStatus::kEdgesOff;
}

}  // namespace

bool IsKnown(const Ellipse& dot, const std::vector<Target>& known, const PlaceIndex& index) {
  const double most = 0.5 * dot.semi_minor_px;
  return index.AnyNear(dot.x_px, dot.y_px, most, [&](int number) {
    const Ellipse& other = known[static_cast<std::size_t>(number)].edge.ellipse;
    const double reach = std::min(most, 0.5 * other.semi_minor_px);
    return std::hypot(dot.x_px - other.x_px, dot.y_px - other.y_px) < reach;
  });
}

RingPlaces::RingPlaces(const CodeFamily& family, int width, int height)
    : most_(family.ring_outer + kBeyondRing), index_(width, height) {}

void RingPlaces::Add(const Target& target) {
  if (!HasRing(target)) return;
  const EllipseFrame frame = EllipseFrame::From(target.edge.ellipse);
  const Ellipse& dot = target.edge.ellipse;
  index_.Insert(dot.x_px, dot.y_px, static_cast<int>(owners_.size()));
  owners_.push_back({frame.center, frame.shape.inverse(), dot.semi_minor_px});
  reach_px_ = std::max(reach_px_, most_ * dot.semi_major_px);
}

bool RingPlaces::Holds(const Eigen::Vector2d& center, double semi_minor_px) const {
  if (owners_.empty()) return false;
  return index_.AnyNear(center.x(), center.y(), reach_px_, [&](int number) {
    const Owner& owner = owners_[static_cast<std::size_t>(number)];
    const double radius = (owner.inverse * (center - owner.center)).norm();
    return radius > 1.0 && radius < most_ && semi_minor_px < owner.semi_minor_px;
  });
}

void RemoveRingPieces(const CodeFamily& family, int width, int height,
                      std::vector<Target>* targets) {
  RingPlaces rings(family, width, height);
  for (const Target& target : *targets) rings.Add(target);
  std::erase_if(*targets, [&](const Target& target) {
    const Ellipse& e = target.edge.ellipse;
    return rings.Holds({e.x_px, e.y_px}, e.semi_minor_px);
  });
}

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

}  // namespace videogrammetry
