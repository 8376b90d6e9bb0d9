// An un-coded point where a code is read is that code: tracker.h, step 5.
#include <algorithm>
#include <cmath>
#include <limits>

#include "videogrammetry/tracking/tracker_state.h"

namespace videogrammetry {

void NameByCode(TrackerState& s) {
  std::vector<int> coded;
  std::vector<Eigen::Vector3d> places, loose_places;
  for (std::size_t r = 0; r < s.rows.size(); ++r) {
    if (s.rows.id[r] < 0) continue;
    coded.push_back(static_cast<int>(r));
    places.push_back(s.rows.position_mm[r]);
  }
  std::vector<int> loose;
  for (const int t : s.active) {
    const Track& track = s.track(t);
    if (track.row < 0 && !track.dead && track.group < 0 && track.number >= s.first_free_id)
      loose.push_back(t);
  }
  if (coded.empty() || loose.empty()) return;
  const PointIndex index(places);
  BodyMotions bodies(s);
  std::vector<double> reach;
  for (const int t : loose) {
    const Track& track = s.track(t);
    const NeighbourMotion* motion = bodies.Since(track);
    std::optional<NeighbourMotion::Place> place;
    if (motion) place = bodies.Move(*motion, track);
    loose_places.push_back(place ? place->position_mm : track.predicted.position_mm());
    const double variance =
        place ? place->variance_mm2 : track.predicted.position_cov_mm2().trace() / 3.0;
    reach.push_back(place || track.settled
                        ? s.options.gate_sigma *
                              std::sqrt(3.0 * (variance + s.rows.largest_variance_mm2))
                        : std::numeric_limits<double>::infinity());
  }
  const PointIndex loose_index(loose_places);
  std::vector<PointIndex::Neighbour> found;
  for (std::size_t k = 0; k < loose.size(); ++k) {
    const double limit = std::min(reach[k], s.options.max_share_of_spacing *
                                                std::min(s.rows.index.Distance(loose_places[k], 2),
                                                         loose_index.Distance(loose_places[k], 2)));
    index.Nearest(loose_places[k], 1, limit, &found);
    if (found.empty()) continue;
    const int row = coded[static_cast<std::size_t>(found[0].index)];
    const int holder = s.rows.track[static_cast<std::size_t>(row)];
    Track& track = s.track(loose[k]);
    if (holder >= 0) {
      const Track& other = s.track(holder);
      const bool beside = (other.seen & track.seen) != 0 || other.group >= 0;
      const bool forgotten = other.first_seen < s.stage - 63 &&
                             other.last_seen >= track.first_seen && track.first_seen < s.stage - 63;
      if (beside || forgotten) continue;  // seen side by side: two points
      track.first_seen = std::min(track.first_seen, other.first_seen);
      track.hits += other.hits;
      track.seen |= other.seen;
      s.track(holder).dead = true;
      s.track(holder).row = -1;
    }
    s.Rename(loose[k], track.number, s.rows.id[static_cast<std::size_t>(row)]);
    s.Give(loose[k], row, kCodeOdds);
  }
}

}  // namespace videogrammetry
