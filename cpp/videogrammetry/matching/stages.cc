#include "videogrammetry/matching/stages.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

#include "videogrammetry/matching/stage_matcher.h"
#include "videogrammetry/matching/tracks.h"

namespace videogrammetry {
namespace {

// Stages for which an unseen point is looked for.
constexpr int kMaxMissed = 3;
// A new point's second place is nearer than this share of the points' distances.
constexpr double kFirstStep = 0.5;
constexpr double kMostLogOdds = 700.0;

class Chunk {
 public:
  Chunk(const Rig& rig, const std::vector<FlatTargets>& cameras, const MatchingOptions& options,
        const std::map<std::size_t, MatchEdits>& edits)
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

  StageMatches Run() {
    for (std::size_t s = 0; s < num_stages_; ++s) Forward(s);
    Backward();
    return Result();
  }

 private:
  struct Found {
    std::size_t stage, track;
    std::vector<ViewTarget> used;
    double chi2;
    Eigen::Vector3d position_mm;
    Eigen::Matrix3d cov_mm2;
  };

  static MatchingOptions Likely(MatchingOptions options) {
    options.min_log_odds = 0;
    return options;
  }

  std::size_t Flat(const ViewTarget& s, std::size_t stage) const {
    return cameras_[static_cast<std::size_t>(s.camera)].offsets[stage] +
           static_cast<std::size_t>(s.target);
  }
  TargetMatch& Status(const ViewTarget& s, std::size_t stage) {
    return status_[static_cast<std::size_t>(s.camera)][Flat(s, stage)];
  }
  bool IsFree(const ViewTarget& s, std::size_t stage) {
    const TargetMatch status = Status(s, stage);
    return status != TargetMatch::kMatched && status != TargetMatch::kInconsistentId;
  }

  void LoadStage(std::size_t stage) {
    for (std::size_t c = 0; c < num_cameras_; ++c) {
      const FlatTargets& own = cameras_[c];
      const std::size_t first = own.offsets[stage], count = own.offsets[stage + 1] - first;
      targets_[c].Set(views_[c], std::span(own.targets.xy_px).subspan(first, count),
                      std::span(own.targets.cov_px2).subspan(first, count));
    }
  }

  void Forward(std::size_t stage) {
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

  bool Alive(const TrackedPoint& track) const {
    if (track.missed > kMaxMissed || (!track.has_velocity && track.missed > 0)) return false;
    return track.id >= 0 || track.by_user || track.log_odds >= 0;
  }

  // By ID: all of a stage's codes in one sorted list.
  void MatchCoded(std::size_t stage) {
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

  // A code that is read once a camera and whose rays meet; all others are the search's.
  void OneCode(std::size_t stage, std::size_t first, std::size_t last) {
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

  const TargetView& View(const ViewTarget& s) const {
    return targets_[static_cast<std::size_t>(s.camera)];
  }
  static std::size_t Index(const ViewTarget& s) { return static_cast<std::size_t>(s.target); }

  // Valid rays that meet, with sizes that agree.
  bool RaysMeet(std::span<const ViewTarget> used, PointEstimate* point) const {
    for (const ViewTarget& s : used) {
      if (!View(s).valid(Index(s))) return false;
    }
    return AdjustPoint(views_, targets_, used, point) &&
           point->chi2 <= chi2_limit_[2 * used.size() - 4];
  }

  bool SizesAgree(std::size_t stage, std::span<const ViewTarget> used,
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

  void MatchPredicted(std::size_t stage) {
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

  // The targets nearest to where a point is expected, if their rays meet: used_.
  bool FindPredicted(std::size_t stage, int id, const Eigen::Matrix3d& cov, PointEstimate* point,
                     double* gain) {
    const double gate = options_.critical_value * options_.critical_value + 2.0;
    used_.clear();
    double log_ratio = 0;
    for (std::size_t c = 0; c < num_cameras_; ++c) {
      Eigen::Vector2d xy;
      Eigen::Matrix<double, 2, 3> by;
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

  // used_, less those that do not fit; false if fewer than two are left.
  bool MeetWithoutWorst(std::size_t stage, PointEstimate* point) {
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

  std::size_t NewTrack(int id, double log_odds) {
    TrackedPoint track;
    track.id = id;
    track.log_odds = log_odds;
    tracks_.push_back(std::move(track));
    alive_.push_back(tracks_.size() - 1);
    if (id >= 0) track_of_id_[id] = tracks_.size() - 1;
    return tracks_.size() - 1;
  }

  // A track's match of a stage: filter, list and status.
  void Follow(std::size_t stage, std::size_t t, const PointEstimate& point,
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

  void Note(std::size_t stage, std::size_t t, const PointEstimate& point,
            const std::vector<ViewTarget>& used) {
    tracks_[t].matches.push_back(found_.size());
    found_.push_back({stage, t, used, point.chi2, point.position_mm, point.cov_mm2()});
    for (const ViewTarget& s : used) Status(s, stage) = TargetMatch::kMatched;
  }

  // The full search among what is free.
  void SearchRest(std::size_t stage, const MatchEdits* edits) {
    std::size_t cameras_left = 0;
    for (std::size_t c = 0; c < num_cameras_; ++c) {
      const auto begin =
          status_[c].begin() + static_cast<std::ptrdiff_t>(cameras_[c].offsets[stage]);
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

  void AddSearched(std::size_t stage, const MatchResult& result,
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

  // Which points of the stage before, without a velocity yet, go on in which match:
  // nearest to one another, nearer than the points are to each other.
  std::vector<std::size_t> Continued(std::size_t stage, const MatchResult& result,
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

  // Points to stages before the first at which they were found.
  void Backward() {
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
        if (edits_.contains(stage) ||
            !FindPredicted(stage, track.id, track.cov_pp, &point, &gain) ||
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

  // From its third place to its first, so that the filter runs the other way.
  void BeginBackward(std::size_t t) {
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

  StageMatches Result() {
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

  struct Code {
    int id;
    ViewTarget place;
  };
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  const std::vector<FlatTargets>& cameras_;
  const MatchingOptions& options_;
  const std::map<std::size_t, MatchEdits>& edits_;
  StageMatcher search_;
  std::size_t num_cameras_, num_stages_ = 0;
  std::vector<CameraView> views_;
  std::vector<TargetView> targets_;
  std::vector<double> chi2_limit_;  // by degrees of freedom - 1
  std::vector<std::vector<TargetMatch>> status_;
  std::vector<TrackedPoint> tracks_;
  std::vector<std::size_t> alive_, order_;
  std::map<int, std::size_t> track_of_id_;
  std::vector<Found> found_;
  std::vector<Code> codes_;
  std::vector<ViewTarget> used_;
};

void CheckFlat(const Rig& rig, const std::vector<FlatTargets>& cameras,
               const std::map<std::size_t, MatchEdits>& edits) {
  if (cameras.size() != rig.size()) {
    throw std::invalid_argument("cameras: expected " + std::to_string(rig.size()) +
                                " (the rig's number), got " + std::to_string(cameras.size()));
  }
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    const std::vector<std::size_t>& offsets = cameras[c].offsets;
    const CameraTargets& t = cameras[c].targets;
    if (t.cov_px2.size() != t.size() || t.id.size() != t.size() ||
        t.semi_major_px.size() != t.size()) {
      throw std::invalid_argument("targets: xy_px, cov_px2, id and semi_major_px differ in length");
    }
    if (offsets.empty() || offsets.front() != 0 || offsets.back() != t.size() ||
        !std::is_sorted(offsets.begin(), offsets.end())) {
      throw std::invalid_argument("offsets of camera " + std::to_string(c) +
                                  ": expected to rise from 0 to the number of targets, " +
                                  std::to_string(t.size()));
    }
    if (offsets.size() != cameras[0].offsets.size()) {
      throw std::invalid_argument(
          "offsets: camera 0 has " + std::to_string(cameras[0].offsets.size() - 1) +
          " stages, camera " + std::to_string(c) + " has " + std::to_string(offsets.size() - 1));
    }
  }
  const std::size_t stages = cameras.empty() ? 0 : cameras[0].offsets.size() - 1;
  if (!edits.empty() && edits.rbegin()->first >= stages) {
    throw std::invalid_argument("edits: stage " + std::to_string(edits.rbegin()->first) +
                                " is not among the " + std::to_string(stages) + " stages");
  }
}

}  // namespace

StageMatches MatchStages(const Rig& rig, const std::vector<FlatTargets>& cameras,
                         const MatchingOptions& options,
                         const std::map<std::size_t, MatchEdits>& edits) {
  CheckFlat(rig, cameras, edits);
  return Chunk(rig, cameras, options, edits).Run();
}

}  // namespace videogrammetry
