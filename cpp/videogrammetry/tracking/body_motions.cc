#include <algorithm>
#include <cmath>

#include "videogrammetry/tracking/tracker_state.h"

namespace videogrammetry {
namespace {

constexpr double kRefresh = 0.1;  // of the linked points, that many more tell something new

}  // namespace

const NeighbourMotion* BodyMotions::Since(const Track& track) {
  // Beyond the memory the state stands for the point, carried from stage to stage.
  const Track::Position* last = track.At(track.last_seen);
  return From(last ? track.last_seen : s_.stage - 1);
}

bool BodyMotions::Rigid() {
  const NeighbourMotion* motion = From(s_.stage - 1);
  return !motion || motion->rigid();  // too few points tell nothing
}

const NeighbourMotion* BodyMotions::From(int from) {
  auto [entry, fresh] = from_.try_emplace(from);
  if (fresh) {
    std::vector<Eigen::Vector3d> before, after;
    std::vector<double> variance;
    for (const int t : s_.active) {
      const Track& other = s_.track(t);
      const Track::Position* p = other.row >= 0 ? other.At(from) : nullptr;
      if (!p) continue;
      const auto row = static_cast<std::size_t>(other.row);
      before.push_back(p->position_mm);
      after.push_back(s_.rows.position_mm[row]);
      variance.push_back(p->variance_mm2 + s_.rows.variance_mm2[row]);
    }
    if (std::ssize(before) >= NeighbourMotion::kLeastPoints) {
      std::nth_element(variance.begin(), variance.begin() + std::ssize(variance) / 2,
                       variance.end());
      entry->second.emplace(std::move(before), std::move(after),
                            std::sqrt(variance[variance.size() / 2]), s_.options.neighbours);
    }
  }
  return entry->second ? &*entry->second : nullptr;
}

NeighbourMotion::Place BodyMotions::Move(const NeighbourMotion& motion, const Track& track) const {
  const Track::Position* last = track.At(track.last_seen);
  NeighbourMotion::Place place = motion.Move(last ? last->position_mm : track.state.position_mm());
  place.variance_mm2 += last ? last->variance_mm2 : std::pow(track.state.deviation_mm(), 2);
  return place;
}

const std::optional<NeighbourMotion::Place>& BodyMotions::PlaceOf(int t) {
  auto [entry, fresh] = place_of_.try_emplace(t);
  if (fresh) {
    if (const NeighbourMotion* motion = Since(s_.track(t))) {
      entry->second = Move(*motion, s_.track(t));
    }
  }
  return entry->second;
}

void BodyMotions::Refresh() {
  const auto linked = static_cast<int>(
      std::count_if(s_.rows.track.begin(), s_.rows.track.end(), [](int t) { return t >= 0; }));
  if (linked_ >= 0 && linked <= linked_ + kRefresh * linked_) return;
  linked_ = linked;
  from_.clear();
  place_of_.clear();
}

}  // namespace videogrammetry
