#include <algorithm>

#include "videogrammetry/matching/chunk.h"

namespace videogrammetry {
namespace {

// A new point's second place is nearer than this share of the points' distances.
constexpr double kFirstStep = 0.5;

}  // namespace

void Chunk::SearchRest(std::size_t stage, const MatchEdits* edits) {
  std::size_t cameras_left = 0;
  for (std::size_t c = 0; c < num_cameras_; ++c) {
    const auto begin = status_[c].begin() + static_cast<std::ptrdiff_t>(cameras_[c].offsets[stage]);
    const auto end =
        status_[c].begin() + static_cast<std::ptrdiff_t>(cameras_[c].offsets[stage + 1]);
    cameras_left +=
        std::any_of(begin, end, [](TargetMatch m) { return m != TargetMatch::kMatched; });
  }
  if (cameras_left < 2) return;
  std::vector<CameraTargets> left(num_cameras_);
  std::vector<std::vector<int>> place(num_cameras_);
  for (std::size_t c = 0; c < num_cameras_; ++c) {
    const FlatTargets& own = cameras_[c];
    for (std::size_t m = own.offsets[stage]; m < own.offsets[stage + 1]; ++m) {
      if (status_[c][m] == TargetMatch::kMatched) continue;
      left[c].xy_px.push_back(own.targets.xy_px[m]);
      left[c].cov_px2.push_back(own.targets.cov_px2[m]);
      left[c].id.push_back(own.targets.id[m]);
      left[c].semi_major_px.push_back(own.targets.semi_major_px[m]);
      place[c].push_back(static_cast<int>(m - own.offsets[stage]));
    }
  }
  const MatchResult result = search_.Match(left, edits != nullptr ? *edits : MatchEdits{});
  for (std::size_t c = 0; c < num_cameras_; ++c) {
    for (std::size_t k = 0; k < place[c].size(); ++k) {
      Status({static_cast<int>(c), place[c][k]}, stage) = result.status[c][k];
    }
  }
  AddSearched(stage, result, place);
}

void Chunk::AddSearched(std::size_t stage, const MatchResult& result,
                        const std::vector<std::vector<int>>& place) {
  std::vector<PointEstimate> points;
  std::vector<std::vector<ViewTarget>> used;
  for (const Match& match : result.matches) {
    std::vector<ViewTarget> own;
    for (std::size_t c = 0; c < num_cameras_; ++c) {
      if (match.target[c] < 0) continue;
      own.push_back({static_cast<int>(c), place[c][static_cast<std::size_t>(match.target[c])]});
    }
    PointEstimate point;
    point.position_mm = match.position_mm;
    AdjustPoint(views_, targets_, own, &point);
    points.push_back(point);
    used.push_back(std::move(own));
  }
  const std::vector<std::size_t> track = Continued(stage, result, points);
  for (std::size_t k = 0; k < points.size(); ++k) {
    const Match& match = result.matches[k];
    const bool by_user = match.false_probability == 0;
    std::size_t t = track[k];
    if (t == kNone && match.id >= 0) {
      const auto known = track_of_id_.find(match.id);
      if (known != track_of_id_.end() && tracks_[known->second].last_stage != stage) {
        t = known->second;
      }
    }
    if (t == kNone) t = NewTrack(match.id, match.log_odds);
    tracks_[t].log_odds = std::max(tracks_[t].log_odds, match.log_odds);
    tracks_[t].by_user = tracks_[t].by_user || by_user;
    Follow(stage, t, points[k], used[k]);
  }
}

std::vector<std::size_t> Chunk::Continued(std::size_t stage, const MatchResult& result,
                                          const std::vector<PointEstimate>& points) const {
  std::vector<std::size_t> track(points.size(), kNone);
  std::vector<std::size_t> fresh;
  for (const std::size_t t : alive_) {
    const TrackedPoint& own = tracks_[t];
    if (own.last_stage == stage || own.matches.empty() || own.id >= 0) continue;
    fresh.push_back(t);
  }
  if (fresh.empty() || points.empty()) return track;
  std::vector<double> least(fresh.size(), 1e300);
  std::vector<std::size_t> nearest(fresh.size(), kNone), back(points.size(), kNone);
  std::vector<double> back_least(points.size(), 1e300);
  std::vector<double> apart;
  for (std::size_t i = 0; i < fresh.size(); ++i) {
    double own = 1e300;
    const Eigen::Vector3d& from = tracks_[fresh[i]].position_mm;
    for (std::size_t j = 0; j < points.size(); ++j) {
      if (result.matches[j].id >= 0) continue;
      const double d = (points[j].position_mm - from).norm();
      if (d < least[i]) {
        least[i] = d;
        nearest[i] = j;
      }
      if (d < back_least[j]) {
        back_least[j] = d;
        back[j] = i;
      }
    }
    for (const std::size_t o : alive_) {
      if (o != fresh[i]) own = std::min(own, (tracks_[o].position_mm - from).norm());
    }
    apart.push_back(own);
  }
  for (std::size_t i = 0; i < fresh.size(); ++i) {
    if (nearest[i] == kNone || back[nearest[i]] != i) continue;
    if (least[i] < kFirstStep * apart[i]) track[nearest[i]] = fresh[i];
  }
  return track;
}

}  // namespace videogrammetry
