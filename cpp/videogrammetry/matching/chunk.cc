#include "videogrammetry/matching/chunk.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace videogrammetry {
namespace {

// Stages for which an unseen point is looked for.
constexpr int kMaxMissed = 3;
constexpr double kMostLogOdds = 700.0;

}  // namespace

Chunk::Chunk(const Rig& rig, const std::vector<FlatTargets>& cameras,
             const MatchingOptions& options, const std::map<std::size_t, MatchEdits>& edits)
    : cameras_(cameras),
      options_(options),
      edits_(edits),
      search_(rig, Likely(options)),
      num_cameras_(rig.size()) {
  for (const OrientedCamera& camera : rig) views_.emplace_back(camera);
  targets_.resize(rig.size());
  num_stages_ = cameras.empty() ? 0 : cameras[0].offsets.size() - 1;
  for (const FlatTargets& c : cameras) {
    status_.emplace_back(c.targets.size(), TargetMatch::kNoPartner);
  }
  for (std::size_t d = 1; d < 2 * std::max<std::size_t>(num_cameras_, 2); ++d) {
    chi2_limit_.push_back(ChiSquareLimit(static_cast<int>(d), options.critical_value));
  }
}

StageMatches Chunk::Run() {
  for (std::size_t s = 0; s < num_stages_; ++s) Forward(s);
  Backward();
  for (std::size_t s = 0; s < num_stages_; ++s) {
    if (!edits_.contains(s)) NameInconsistentCodes(s);
  }
  return Result();
}

MatchingOptions Chunk::Likely(MatchingOptions options) {
  options.min_log_odds = 0;
  return options;
}

void Chunk::LoadStage(std::size_t stage) {
  for (std::size_t c = 0; c < num_cameras_; ++c) {
    const FlatTargets& own = cameras_[c];
    const std::size_t first = own.offsets[stage], count = own.offsets[stage + 1] - first;
    targets_[c].Set(views_[c], std::span(own.targets.xy_px).subspan(first, count),
                    std::span(own.targets.cov_px2).subspan(first, count));
  }
}

void Chunk::Forward(std::size_t stage) {
  LoadStage(stage);
  for (const std::size_t t : alive_) {
    if (tracks_[t].has_velocity) tracks_[t].Predict();
  }
  const auto edit = edits_.find(stage);
  if (edit == edits_.end()) {
    MatchCoded(stage);
    MatchPredicted(stage);
  }
  SearchRest(stage, edit == edits_.end() ? nullptr : &edit->second);
  for (const std::size_t t : alive_) {
    TrackedPoint& track = tracks_[t];
    if (track.last_stage != stage || track.matches.empty()) ++track.missed;
  }
  std::erase_if(alive_, [&](std::size_t t) { return !Alive(tracks_[t]); });
}

bool Chunk::Alive(const TrackedPoint& track) const {
  if (track.missed > kMaxMissed || (!track.has_velocity && track.missed > 0)) return false;
  return track.id >= 0 || track.by_user || track.log_odds >= 0;
}

std::size_t Chunk::NewTrack(int id, double log_odds) {
  TrackedPoint track;
  track.id = id;
  track.log_odds = log_odds;
  tracks_.push_back(std::move(track));
  alive_.push_back(tracks_.size() - 1);
  if (id >= 0) track_of_id_[id] = tracks_.size() - 1;
  return tracks_.size() - 1;
}

void Chunk::Follow(std::size_t stage, std::size_t t, const PointEstimate& point,
                   const std::vector<ViewTarget>& used) {
  TrackedPoint& track = tracks_[t];
  if (track.matches.empty() || !Alive(track)) {
    if (!track.matches.empty()) alive_.push_back(t);  // a code that comes back
    track.Begin(point);
  } else if (track.has_velocity) {
    track.Update(point);
  } else {
    track.GiveVelocity(point, static_cast<double>(stage - track.last_stage));
  }
  track.missed = 0;
  track.last_stage = stage;
  Note(stage, t, point, used);
}

void Chunk::Note(std::size_t stage, std::size_t t, const PointEstimate& point,
                 const std::vector<ViewTarget>& used) {
  tracks_[t].matches.push_back(found_.size());
  found_.push_back({stage, t, used, point.chi2, point.position_mm, point.cov_mm2()});
  for (const ViewTarget& s : used) Status(s, stage) = TargetMatch::kMatched;
}

void Chunk::Backward() {
  std::vector<std::vector<std::size_t>> begins(num_stages_ + 1);
  for (std::size_t t = 0; t < tracks_.size(); ++t) {
    const TrackedPoint& track = tracks_[t];
    if (track.matches.size() < 3) continue;
    if (track.id < 0 && !track.by_user && track.log_odds < options_.min_log_odds) continue;
    begins[found_[track.matches[0]].stage].push_back(t);
  }
  std::vector<std::size_t> going;
  for (std::size_t stage = num_stages_; stage-- > 0;) {
    for (const std::size_t t : begins[stage + 1]) {
      BeginBackward(t);
      going.push_back(t);
    }
    if (going.empty()) continue;
    LoadStage(stage);
    std::erase_if(going, [&](std::size_t t) {
      TrackedPoint& track = tracks_[t];
      track.Predict();
      PointEstimate point;
      point.position_mm = track.position_mm;
      double gain = 0;
      // What the user has decided about a stage stands.
      if (edits_.contains(stage) || !FindPredicted(stage, track.id, track.cov_pp, &point, &gain) ||
          track.log_odds + gain < options_.min_log_odds) {
        return ++track.missed > kMaxMissed;
      }
      track.missed = 0;
      track.log_odds = std::min(track.log_odds + gain, kMostLogOdds);
      track.Update(point);
      Note(stage, t, point, used_);
      return false;
    });
  }
}

void Chunk::BeginBackward(std::size_t t) {
  TrackedPoint& track = tracks_[t];
  const auto at = [&](std::size_t k) {
    const Found& f = found_[track.matches[k]];
    PointEstimate point;
    point.position_mm = f.position_mm;
    point.information = f.cov_mm2.inverse();
    return point;
  };
  const std::size_t last = found_[track.matches[2]].stage;
  const std::size_t middle = found_[track.matches[1]].stage;
  const std::size_t first = found_[track.matches[0]].stage;
  track.Begin(at(2));
  track.GiveVelocity(at(1), static_cast<double>(last - middle));
  for (std::size_t k = middle; k-- > first;) track.Predict();
  track.Update(at(0));
  track.missed = 0;
}

StageMatches Chunk::Result() {
  StageMatches result;
  std::vector<std::size_t> order;
  for (std::size_t k = 0; k < found_.size(); ++k) {
    const TrackedPoint& track = tracks_[found_[k].track];
    if (track.id >= 0 || track.by_user || track.log_odds >= options_.min_log_odds) {
      order.push_back(k);
    } else {
      for (const ViewTarget& s : found_[k].used) {
        Status(s, found_[k].stage) = TargetMatch::kAmbiguous;
      }
    }
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return found_[a].stage != found_[b].stage ? found_[a].stage < found_[b].stage
                                              : found_[a].track < found_[b].track;
  });
  result.offsets.assign(num_stages_ + 1, 0);
  result.target.reserve(order.size() * num_cameras_);
  for (const std::size_t k : order) {
    const Found& f = found_[k];
    const TrackedPoint& track = tracks_[f.track];
    ++result.offsets[f.stage + 1];
    const std::size_t row = result.target.size();
    result.target.resize(row + num_cameras_, -1);
    for (const ViewTarget& s : f.used) {
      result.target[row + static_cast<std::size_t>(s.camera)] = s.target;
    }
    result.id.push_back(track.id);
    result.chi2.push_back(f.chi2);
    result.log_odds.push_back(track.log_odds);
    result.false_probability.push_back(track.by_user ? 0.0 : 1 / (1 + std::exp(track.log_odds)));
  }
  std::partial_sum(result.offsets.begin(), result.offsets.end(), result.offsets.begin());
  result.status = std::move(status_);
  return result;
}

}  // namespace videogrammetry
