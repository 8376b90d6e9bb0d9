#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "videogrammetry/matching/chunk.h"

namespace videogrammetry {
namespace {

constexpr double kMostLogOdds = 700.0;

}  // namespace

void Chunk::MatchCoded(std::size_t stage) {
  codes_.clear();
  for (std::size_t c = 0; c < num_cameras_; ++c) {
    const FlatTargets& own = cameras_[c];
    for (std::size_t m = own.offsets[stage]; m < own.offsets[stage + 1]; ++m) {
      if (own.targets.id[m] < 0) continue;
      codes_.push_back(
          {own.targets.id[m], {static_cast<int>(c), static_cast<int>(m - own.offsets[stage])}});
    }
  }
  std::sort(codes_.begin(), codes_.end(), [](const Code& a, const Code& b) {
    if (a.id != b.id) return a.id < b.id;
    return a.place.camera != b.place.camera ? a.place.camera < b.place.camera
                                            : a.place.target < b.place.target;
  });
  for (std::size_t first = 0; first < codes_.size();) {
    std::size_t last = first;
    while (last < codes_.size() && codes_[last].id == codes_[first].id) ++last;
    OneCode(stage, first, last);
    first = last;
  }
}

void Chunk::OneCode(std::size_t stage, std::size_t first, std::size_t last) {
  if (last - first < 2) return;
  used_.clear();
  for (std::size_t k = first; k < last; ++k) {
    if (k > first && codes_[k].place.camera == codes_[k - 1].place.camera) return;
    used_.push_back(codes_[k].place);
  }
  PointEstimate point;
  const int id = codes_[first].id;
  const auto known = track_of_id_.find(id);
  if (known != track_of_id_.end() && Alive(tracks_[known->second])) {
    point.position_mm = tracks_[known->second].position_mm;
  } else if (!MeetingPoint(View(used_[0]), Index(used_[0]), View(used_[1]), Index(used_[1]),
                           &point.position_mm)) {
    return;
  }
  if (!RaysMeet(used_, &point)) return;
  const std::size_t track =
      known != track_of_id_.end() ? known->second : NewTrack(id, kMostLogOdds);
  Follow(stage, track, point, used_);
}

void Chunk::NameInconsistentCodes(std::size_t stage) {
  std::vector<Code> left;
  for (std::size_t c = 0; c < num_cameras_; ++c) {
    const FlatTargets& own = cameras_[c];
    for (std::size_t m = own.offsets[stage]; m < own.offsets[stage + 1]; ++m) {
      const ViewTarget place{static_cast<int>(c), static_cast<int>(m - own.offsets[stage])};
      if (own.targets.id[m] >= 0 && IsFree(place, stage)) {
        left.push_back({own.targets.id[m], place});
      }
    }
  }
  for (const Code& code : left) {
    bool elsewhere = false;
    for (std::size_t c = 0; c < num_cameras_ && !elsewhere; ++c) {
      if (static_cast<int>(c) == code.place.camera) continue;
      const FlatTargets& own = cameras_[c];
      const auto begin = own.targets.id.begin();
      const auto first = begin + static_cast<std::ptrdiff_t>(own.offsets[stage]);
      const auto last = begin + static_cast<std::ptrdiff_t>(own.offsets[stage + 1]);
      elsewhere = std::find(first, last, code.id) != last;
    }
    if (elsewhere) Status(code.place, stage) = TargetMatch::kInconsistentId;
  }
}

bool Chunk::RaysMeet(std::span<const ViewTarget> used, PointEstimate* point) const {
  for (const ViewTarget& s : used) {
    if (!View(s).valid(Index(s))) return false;
  }
  return AdjustPoint(views_, targets_, used, point) &&
         point->chi2 <= chi2_limit_[2 * used.size() - 4];
}

bool Chunk::SizesAgree(std::size_t stage, std::span<const ViewTarget> used,
                       const PointEstimate& point) const {
  if (options_.max_size_ratio <= 0) return true;
  double smallest = 0, largest = 0;
  for (const ViewTarget& s : used) {
    const auto c = static_cast<std::size_t>(s.camera);
    const double a = cameras_[c].targets.semi_major_px[Flat(s, stage)];
    if (!(a > 0)) continue;
    const double size = a * views_[c].depth_mm(point.position_mm) / views_[c].f_px();
    smallest = smallest == 0 ? size : std::min(smallest, size);
    largest = std::max(largest, size);
  }
  return largest <= options_.max_size_ratio * smallest;
}

void Chunk::MatchPredicted(std::size_t stage) {
  // The surest first: what two claim is theirs.
  order_ = alive_;
  std::stable_sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) {
    return tracks_[a].log_odds > tracks_[b].log_odds;
  });
  for (const std::size_t t : order_) {
    TrackedPoint& track = tracks_[t];
    if (!track.has_velocity || track.last_stage == stage) continue;
    PointEstimate point;
    point.position_mm = track.position_mm;
    double gain = 0;
    if (!FindPredicted(stage, track.id, track.cov_pp, &point, &gain)) continue;
    track.log_odds = std::min(track.log_odds + gain, kMostLogOdds);
    if (track.id < 0 && !track.by_user && track.log_odds < 0) continue;  // dissolved
    Follow(stage, t, point, used_);
  }
}

bool Chunk::FindPredicted(std::size_t stage, int id, const Eigen::Matrix3d& cov,
                          PointEstimate* point, double* gain) {
  const double gate = options_.critical_value * options_.critical_value + 2.0;
  used_.clear();
  double log_ratio = 0;
  for (std::size_t c = 0; c < num_cameras_; ++c) {
    Eigen::Vector2d xy;
    Eigen::Matrix<double, 2, 3> by;
    targets_[c].MakeGrid();
    if (targets_[c].size() == 0 || !views_[c].Project(point->position_mm, &xy, &by)) continue;
    const Eigen::Matrix2d predicted = by * cov * by.transpose();
    const double sigma = targets_[c].max_sigma();
    const Eigen::Vector2d reach = (gate * (predicted.diagonal().array() + sigma * sigma)).sqrt();
    double best = gate, ratio = 0;
    int own = -1;
    targets_[c].ForBox(xy - reach, xy + reach, [&](std::size_t k) {
      const ViewTarget place{static_cast<int>(c), static_cast<int>(k)};
      if (!targets_[c].valid(k) || !IsFree(place, stage)) return;
      const int code = cameras_[c].targets.id[Flat(place, stage)];
      if (code >= 0 && code != id) return;
      const Eigen::Vector2d away = targets_[c].xy(k) - xy;
      const Eigen::Matrix2d total = predicted + targets_[c].cov(k);
      const double determinant = total.determinant();
      const double distance2 =
          (total(1, 1) * away.x() * away.x() + total(0, 0) * away.y() * away.y() -
           2 * total(0, 1) * away.x() * away.y()) /
          determinant;
      if (distance2 < best || (distance2 == best && static_cast<int>(k) < own)) {
        best = distance2;
        own = static_cast<int>(k);
        ratio = determinant * targets_[c].weight(k).determinant();
      }
    });
    if (own < 0) continue;
    used_.push_back({static_cast<int>(c), own});
    log_ratio += 0.25 * std::log(ratio);  // of one coordinate
  }
  if (used_.size() < 2) return false;
  const double log_k = log_ratio / static_cast<double>(used_.size());
  if (!MeetWithoutWorst(stage, point)) return false;
  const auto dof = static_cast<double>(2 * used_.size() - 3);
  *gain = dof * log_k - 0.5 * point->chi2 * (1 - std::exp(-2 * log_k));
  return true;
}

bool Chunk::MeetWithoutWorst(std::size_t stage, PointEstimate* point) {
  const Eigen::Vector3d start = point->position_mm;
  while (used_.size() >= 2) {
    point->position_mm = start;
    if (RaysMeet(used_, point) && SizesAgree(stage, used_, *point)) return true;
    if (used_.size() == 2) return false;
    std::size_t worst = 0;
    double most = -1;
    for (std::size_t k = 0; k < used_.size(); ++k) {
      Eigen::Vector2d xy;
      const auto c = static_cast<std::size_t>(used_[k].camera);
      if (!views_[c].Project(point->position_mm, &xy)) return false;
      const Eigen::Vector2d away = targets_[c].xy(Index(used_[k])) - xy;
      const double chi2 = away.dot(targets_[c].weight(Index(used_[k])) * away);
      if (chi2 > most) {
        most = chi2;
        worst = k;
      }
    }
    used_.erase(used_.begin() + static_cast<std::ptrdiff_t>(worst));
  }
  return false;
}

}  // namespace videogrammetry
