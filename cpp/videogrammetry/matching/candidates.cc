#include "videogrammetry/matching/candidates.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numbers>

namespace videogrammetry {
namespace {

const double kLogTwoPi = std::log(2 * std::numbers::pi);
// Candidates of lower log odds take no measurable part in anything.
constexpr double kHopeless = -7.0;
// A seed grows into this many sets at most.
constexpr int kMaxLeaves = 24;
// A target that adds less than this to the log odds may as well be another's.
constexpr double kSureGain = 5.0;
// Among many cameras, targets of so sure a set need no further seeds.
constexpr std::size_t kSettledCameras = 6;
constexpr double kSettledScore = 40.0;
// Contested targets of a set whose parts are all looked at.
constexpr std::size_t kMaxContested = 3;
// Two pictures within this many semi-axes of one another may be one target.
constexpr double kMergeAxes = 2.5;
constexpr double kMergedShare = 0.5;
constexpr int kCurveSteps = 18;
// Enough to tell how large the space is.
constexpr std::size_t kVolumePairs = 1000, kVolumeTargets = 100;

// x_b^T E x_a = 0 for b_from_a = (R, t): E = [t]_x R.
Eigen::Matrix3d EssentialMatrix(const OrientedCamera& a, const OrientedCamera& b) {
  const Rigid3 b_from_a = b.cam_from_world * a.cam_from_world.Inverse();
  const Eigen::Vector3d& t = b_from_a.translation_mm;
  Eigen::Matrix3d cross;
  cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  return cross * b_from_a.rotation;
}

std::uint64_t Mix(std::uint64_t x) {  // SplitMix64
  x += 0x9e3779b97f4a7c15U;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebU;
  return x ^ (x >> 31);
}

std::uint64_t Key(const ViewTarget& s) {
  return Mix((static_cast<std::uint64_t>(s.camera) << 32) | static_cast<std::uint32_t>(s.target));
}

// Of a set: does not depend on the order.
std::uint64_t Key(std::span<const ViewTarget> used) {
  std::uint64_t key = 0;
  for (const ViewTarget& s : used) key += Key(s);
  return key;
}

std::uint64_t Key(const ViewTarget& a, const ViewTarget& b) { return Key(a) + Key(b); }

// The miss (o_b - o_a) . (u_a x u_b) of two rays, 0 where they meet, within the gate?
bool RaysMeet(const TargetView& a, std::size_t i, const TargetView& b, std::size_t j,
              double gate2) {
  const auto by = [](const TargetView& v, std::size_t k, Eigen::Matrix<double, 3, 2>* origin,
                     Eigen::Matrix<double, 3, 2>* direction) {
    *origin = v.origin_by_xy(k);
    *direction = v.direction_by_xy(k);
  };
  Eigen::Matrix<double, 3, 2> origin_a, direction_a, origin_b, direction_b;
  by(a, i, &origin_a, &direction_a);
  by(b, j, &origin_b, &direction_b);
  const Eigen::Vector3d u = a.direction(i), v = b.direction(j);
  const Eigen::Vector3d between = b.origin(j) - a.origin(i), across = u.cross(v);
  const Eigen::Vector2d by_a =
      direction_a.transpose() * v.cross(between) - origin_a.transpose() * across;
  const Eigen::Vector2d by_b =
      direction_b.transpose() * between.cross(u) + origin_b.transpose() * across;
  const double miss = between.dot(across);
  return miss * miss <= gate2 * (by_a.dot(a.cov(i) * by_a) + by_b.dot(b.cov(j) * by_b));
}

bool IdsAgree(int a, int b) { return a < 0 || b < 0 || a == b; }

}  // namespace

double ChiSquareLimit(int dof, double z) {
  if (dof == 1) return z * z;
  // One-sided normal quantile of the same level, for z in the range used.
  const double level = std::erfc(z / std::numbers::sqrt2);
  double one_sided = z;
  for (int i = 0; i < 30; ++i) {
    const double p = 0.5 * std::erfc(one_sided / std::numbers::sqrt2);
    const double slope = std::exp(-0.5 * one_sided * one_sided) / std::sqrt(2 * std::numbers::pi);
    if (!(slope > 0)) break;
    one_sided += (p - level) / slope;
  }
  const double k = 2.0 / (9.0 * dof);
  return dof * std::pow(1.0 - k + one_sided * std::sqrt(k), 3);
}

bool Candidate::Contains(const Candidate& smaller) const {
  return std::all_of(smaller.used.begin(), smaller.used.end(), [&](const ViewTarget& s) {
    return std::any_of(used.begin(), used.end(), [&](const ViewTarget& own) {
      return own.camera == s.camera && own.target == s.target;
    });
  });
}

StageStatistics StageStatistics::Start(const std::vector<CameraView>& cameras,
                                       const std::vector<TargetView>& targets, double volume_mm3) {
  StageStatistics statistics;
  double mean = 0;
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    const auto n = static_cast<double>(targets[c].size());
    mean += n / static_cast<double>(cameras.size());
    statistics.log_lone.push_back(std::log(std::max(n, 1.0) / cameras[c].area()));
  }
  statistics.log_density = std::log(std::max(0.5 * mean, 1.0) / volume_mm3);
  const auto n = static_cast<Eigen::Index>(cameras.size());
  statistics.seen = Eigen::MatrixXd::Constant(n, n, 0.8);
  return statistics;
}

double StageStatistics::Score(const Candidate& candidate) const {
  double score = candidate.fixed_score + candidate.surface_score + log_density;
  const auto others = static_cast<double>(candidate.size() - 1);
  for (const ViewTarget& s : candidate.used) {
    double share = 0;
    for (const ViewTarget& o : candidate.used) {
      if (o.camera != s.camera) share += seen(s.camera, o.camera) / others;
    }
    score += std::log(share) - log_lone[static_cast<std::size_t>(s.camera)];
  }
  for (std::uint64_t left = candidate.in_view; left != 0; left &= left - 1) {
    const int c = std::countr_zero(left);
    double share = 0;
    for (const ViewTarget& o : candidate.used) share += seen(c, o.camera) / (others + 1);
    const bool covered = (candidate.covered >> c) & 1U;
    score += std::log(1 - share + (covered ? kMergedShare * share : 0.0));
  }
  return score;
}

CandidateFinder::CandidateFinder(const std::vector<CameraView>& cameras,
                                 const std::vector<TargetView>& targets,
                                 std::span<const CameraTargets> data,
                                 const MatchingOptions& options, const MatchEdits& edits)
    : cameras_(cameras), targets_(targets), data_(data), options_(options) {
  for (const auto& [a, b] : edits.apart) apart_.insert(Key(a, b));
  chi2_limit_.resize(2 * std::max<std::size_t>(cameras.size(), 2));
  for (std::size_t d = 1; d < chi2_limit_.size(); ++d) {
    chi2_limit_[d] = ChiSquareLimit(static_cast<int>(d), options.critical_value);
  }
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    double largest = 0;
    for (const double a : data[c].semi_major_px) largest = std::max(largest, a);
    max_semi_.push_back(largest / cameras[c].f_px());
  }
}

bool CandidateFinder::KeptApart(std::span<const ViewTarget> used) const {
  if (apart_.empty()) return false;
  for (std::size_t i = 0; i < used.size(); ++i) {
    for (std::size_t j = i + 1; j < used.size(); ++j) {
      if (apart_.contains(Key(used[i], used[j]))) return true;
    }
  }
  return false;
}

// Diameter of the dot in mm that each camera's ellipse implies: its major axis
// is not foreshortened, so 2 a Z / f agrees between the cameras.
bool CandidateFinder::SizesAgree(const Candidate& candidate) const {
  if (options_.max_size_ratio <= 0) return true;
  double smallest = 0, largest = 0;
  for (const ViewTarget& s : candidate.used) {
    const auto c = static_cast<std::size_t>(s.camera);
    const double a = data_[c].semi_major_px[static_cast<std::size_t>(s.target)];
    if (!(a > 0)) continue;
    const double size = a * cameras_[c].depth_mm(candidate.point.position_mm) / cameras_[c].f_px();
    smallest = smallest == 0 ? size : std::min(smallest, size);
    largest = std::max(largest, size);
  }
  return largest <= options_.max_size_ratio * smallest;
}

bool CandidateFinder::InRange(const Candidate& candidate) const {
  if (options_.min_distance_mm <= 0 && options_.max_distance_mm <= 0) return true;
  for (const ViewTarget& s : candidate.used) {
    const Eigen::Vector3d& center = cameras_[static_cast<std::size_t>(s.camera)].center();
    const double distance = (candidate.point.position_mm - center).norm();
    if (options_.min_distance_mm > 0 && distance < options_.min_distance_mm) return false;
    if (options_.max_distance_mm > 0 && distance > options_.max_distance_mm) return false;
  }
  return true;
}

bool CandidateFinder::Make(std::span<const ViewTarget> used, Candidate* candidate,
                           bool forced) const {
  candidate->used.assign(used.begin(), used.end());
  candidate->id = -1;
  for (const ViewTarget& s : used) {
    const auto c = static_cast<std::size_t>(s.camera);
    if (!targets_[c].valid(static_cast<std::size_t>(s.target))) return false;
    const int id = IdOf(s);
    if (!IdsAgree(candidate->id, id) && !forced) return false;
    if (candidate->id < 0) candidate->id = id;
  }
  if (!forced && KeptApart(used)) return false;
  bool met = false;
  for (std::size_t k = 1; k < used.size() && !met; ++k) {
    met = MeetingPoint(targets_[static_cast<std::size_t>(used[0].camera)],
                       static_cast<std::size_t>(used[0].target),
                       targets_[static_cast<std::size_t>(used[k].camera)],
                       static_cast<std::size_t>(used[k].target), &candidate->point.position_mm);
  }
  if (!met || !AdjustPoint(cameras_, targets_, used, &candidate->point)) return false;
  if (!forced) {
    if (candidate->point.chi2 > chi2_limit_[2 * used.size() - 3]) return false;
    if (!InRange(*candidate) || !SizesAgree(*candidate)) return false;
  }
  // The integral over the point's place of the product of the densities (Laplace).
  double score = 1.5 * kLogTwoPi - 0.5 * std::log(candidate->point.information.determinant()) -
                 0.5 * candidate->point.chi2;
  for (const ViewTarget& s : used) {
    score -= kLogTwoPi + 0.5 * targets_[static_cast<std::size_t>(s.camera)].log_det(
                                   static_cast<std::size_t>(s.target));
  }
  candidate->fixed_score = score;
  candidate->surface_score = 0;
  Look(candidate);
  return true;
}

// Which cameras would see it and do not, and where another target may be the reason.
void CandidateFinder::Look(Candidate* candidate) const {
  candidate->in_view = candidate->covered = 0;
  std::uint64_t own = 0;
  for (const ViewTarget& s : candidate->used) own |= std::uint64_t{1} << s.camera;
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    if ((own >> c) & 1U) continue;
    Eigen::Vector2d xy;
    if (!cameras_[c].Project(candidate->point.position_mm, &xy)) continue;
    if (!cameras_[c].InPicture(xy)) continue;
    candidate->in_view |= std::uint64_t{1} << c;
    const Eigen::Vector2d reach = Eigen::Vector2d::Constant(kMergeAxes * max_semi_[c]);
    targets_[c].ForBox(xy - reach, xy + reach, [&](std::size_t t) {
      const double limit = kMergeAxes * data_[c].semi_major_px[t] / cameras_[c].f_px();
      if (limit > 0 && (targets_[c].xy(t) - xy).squaredNorm() < limit * limit) {
        candidate->covered |= std::uint64_t{1} << c;
      }
    });
  }
}

// Where the points of a ray may be seen: a straight line, or behind windows a curve.
std::vector<Eigen::Vector2d> CandidateFinder::EpipolarCurve(std::size_t a, std::size_t i,
                                                            std::size_t b) const {
  std::vector<Eigen::Vector2d> curve;
  const Eigen::Vector3d origin = targets_[a].origin(i);
  const Eigen::Vector3d direction = targets_[a].direction(i).normalized();
  const double away = (cameras_[b].center() - cameras_[a].center()).norm();
  // Geometric steps from a twentieth of the base to ten times it; what leaves the
  // picture is cut off, with one step more on either side.
  Eigen::Vector2d before = Eigen::Vector2d::Zero();
  bool had = false, in = false;
  const double least = options_.min_distance_mm > 0 ? 0.5 * options_.min_distance_mm : 0.05 * away;
  const double most = options_.max_distance_mm > 0 ? options_.max_distance_mm : 10.0 * away;
  for (int k = 0; k <= kCurveSteps; ++k) {
    const double t = least * std::pow(most / least, static_cast<double>(k) / kCurveSteps);
    Eigen::Vector2d xy;
    if (!cameras_[b].Project(origin + t * direction, &xy)) continue;
    const bool inside = cameras_[b].InPicture(xy);
    if (inside && !in && had) curve.push_back(before);
    if (inside || in) curve.push_back(xy);
    if (!inside && had && !in && curve.empty() && cameras_[b].InPicture(0.5 * (xy + before))) {
      curve = {before, xy};
    }
    before = xy;
    had = true;
    if (in && !inside) break;
    in = inside;
  }
  return curve;
}

bool CandidateFinder::PairPasses(std::size_t a, std::size_t i, std::size_t b, std::size_t j,
                                 const Eigen::Matrix3d& essential) const {
  const double gate2 = options_.critical_value * options_.critical_value;
  const TargetView &own = targets_[a], &other = targets_[b];
  if (cameras_[a].has_window() && cameras_[b].has_window()) {
    return RaysMeet(own, i, other, j, gate2);
  }
  if (cameras_[a].has_window() || cameras_[b].has_window()) return true;  // judged by Make
  const Eigen::Vector3d x(own.xy(i).x(), own.xy(i).y(), 1);
  const Eigen::Vector3d y(other.xy(j).x(), other.xy(j).y(), 1);
  const Eigen::Vector3d line = essential * x;
  const Eigen::Vector2d by_b = line.head<2>();
  const Eigen::Vector2d by_a = essential.leftCols<2>().transpose() * y;
  const double distance = line.dot(y);
  return distance * distance <=
         gate2 * (by_b.dot(other.cov(j) * by_b) + by_a.dot(own.cov(i) * by_a));
}

template <typename Function>
void CandidateFinder::ForPairs(std::size_t a, std::size_t b,
                               const std::vector<std::vector<char>>& free, std::size_t every,
                               Function f) const {
  const Eigen::Matrix3d essential = EssentialMatrix(cameras_[a].oriented(), cameras_[b].oriented());
  const bool curved = cameras_[a].has_window() || cameras_[b].has_window();
  const TargetView &own = targets_[a], &other = targets_[b];
  std::vector<int> near;
  for (std::size_t i = 0; i < own.size(); i += every) {
    if (!free[a][i] || !own.valid(i)) continue;
    near.clear();
    const auto look = [&](std::size_t j) {
      if (!free[b][j] || !IdsAgree(data_[a].id[i], data_[b].id[j])) return;
      if (PairPasses(a, i, b, j, essential)) near.push_back(static_cast<int>(j));
    };
    const double sigma_a = std::sqrt(own.cov(i).diagonal().maxCoeff());
    std::vector<Eigen::Vector2d> curve;
    double reach = 0;
    if (curved) {
      curve = EpipolarCurve(a, i, b);
      // The deviation of an arc from its chord is an eighth of the second difference.
      double bend = 0;
      for (std::size_t k = 2; k < curve.size(); ++k) {
        const Eigen::Vector2d first = curve[k - 1] - curve[k - 2], last = curve[k] - curve[k - 1];
        const double cross = first.x() * last.y() - first.y() * last.x();
        bend = std::max(bend, std::abs(cross) / std::max(first.norm() + last.norm(), 1e-12));
      }
      reach = options_.critical_value * std::hypot(1.5 * sigma_a, 1.5 * other.max_sigma()) + bend;
    } else {
      const Eigen::Vector3d line = essential * Eigen::Vector3d(own.xy(i).x(), own.xy(i).y(), 1.0);
      const double norm = line.head<2>().norm();
      if (!(norm > 0)) continue;
      const Eigen::Vector2d foot = -line.z() * line.head<2>() / (norm * norm);
      const Eigen::Vector2d along = Eigen::Vector2d(-line.y(), line.x()) / norm;
      // Across the picture: 2 is more than any half diagonal of a lens without a fold.
      const double half = 2.0 + foot.norm();
      curve = {foot - half * along, foot + half * along};
      double most = 0;
      for (const double t : {-1.0, 1.0}) {
        const Eigen::Vector2d end = foot + t * std::min(half, 2.0) * along;
        most = std::max(
            most,
            (essential.leftCols<2>().transpose() * Eigen::Vector3d(end.x(), end.y(), 1)).norm());
      }
      reach = options_.critical_value * std::hypot(sigma_a * most / norm, 1.5 * other.max_sigma());
    }
    for (std::size_t k = 1; k < curve.size(); ++k) {
      other.ForSegment(curve[k - 1], curve[k], reach, look);
    }
    for (const int j : other.wide()) look(static_cast<std::size_t>(j));
    std::sort(near.begin(), near.end());
    near.erase(std::unique(near.begin(), near.end()), near.end());
    for (const int j : near) f(i, static_cast<std::size_t>(j));
  }
}

double CandidateFinder::PairVolume(const std::vector<std::vector<char>>& free) {
  std::array<std::vector<double>, 3> along;
  for (std::size_t a = 0; a < cameras_.size() && along[0].size() < kVolumePairs; ++a) {
    for (std::size_t b = a + 1; b < cameras_.size() && along[0].size() < kVolumePairs; ++b) {
      const std::size_t every = targets_[a].size() / kVolumeTargets + 1;
      ForPairs(a, b, free, every, [&](std::size_t i, std::size_t j) {
        Eigen::Vector3d position;
        if (!MeetingPoint(targets_[a], i, targets_[b], j, &position)) return;
        for (int k = 0; k < 3; ++k) along[static_cast<std::size_t>(k)].push_back(position[k]);
      });
    }
  }
  double volume = 1;
  for (auto& values : along) {
    if (values.size() < 4) return 1e9;
    std::sort(values.begin(), values.end());
    const std::size_t n = values.size();
    volume *= std::max(2 * (values[3 * n / 4] - values[n / 4]), 1e-3);
  }
  return volume;
}

std::vector<Candidate> CandidateFinder::Find(const std::vector<std::vector<char>>& free,
                                             const StageStatistics& statistics) {
  free_ = &free;
  statistics_ = &statistics;
  found_.clear();
  sets_.clear();
  pairs_.clear();
  settled_ = free;
  for (auto& s : settled_) std::fill(s.begin(), s.end(), 0);
  for (std::size_t a = 0; a < cameras_.size(); ++a) {
    for (std::size_t b = a + 1; b < cameras_.size(); ++b) {
      ForPairs(a, b, free, 1, [&](std::size_t i, std::size_t j) { Seed(a, i, b, j); });
    }
  }
  AddParts();
  return std::move(found_);
}

void CandidateFinder::Seed(std::size_t a, std::size_t i, std::size_t b, std::size_t j) {
  if (settled_[a][i] || settled_[b][j]) return;
  Hypothesis pair;
  pair.used = {{static_cast<int>(a), static_cast<int>(i)},
               {static_cast<int>(b), static_cast<int>(j)}};
  if (pairs_.contains(Key(pair.used[0], pair.used[1]))) return;
  Candidate candidate;
  if (!Make(pair.used, &candidate)) return;
  pair.point = candidate.point;
  candidate.in_view = 0;  // the missed cameras are counted as they are passed
  pair.score = statistics_->Score(candidate);
  leaves_ = 0;
  GrowFrom(std::move(pair), 0);
}

void CandidateFinder::NearTargets(const PointEstimate& point, std::size_t c, int id,
                                  const std::vector<std::vector<char>>& free,
                                  std::vector<Near>* near, Eigen::Vector2d* xy,
                                  Eigen::Matrix<double, 2, 3>* by) const {
  near->clear();
  const TargetView& view = targets_[c];
  const double gate = options_.critical_value * options_.critical_value + 2.0;
  const Eigen::Matrix2d predicted = *by * point.cov_mm2() * by->transpose();
  const Eigen::Vector2d reach =
      (gate * (predicted.diagonal().array() + view.max_sigma() * view.max_sigma())).sqrt();
  view.ForBox(*xy - reach, *xy + reach, [&](std::size_t k) {
    if (!free[c][k] || !view.valid(k) || !IdsAgree(id, data_[c].id[k])) return;
    const Eigen::Vector2d difference = view.xy(k) - *xy;
    const Eigen::Matrix2d total = predicted + view.cov(k);
    const double distance2 = difference.dot(total.inverse() * difference);
    if (distance2 < gate) {
      near->push_back({distance2, std::log(total.determinant()), static_cast<int>(k)});
    }
  });
  std::sort(near->begin(), near->end(), [](const Near& p, const Near& q) {
    return p.distance2 != q.distance2 ? p.distance2 < q.distance2 : p.target < q.target;
  });
}

// Goes through the cameras; where one has several targets at the point's place, or one
// that does not say much, each is tried, and none of them.
void CandidateFinder::GrowFrom(Hypothesis h, std::size_t camera) {
  int id = -1;
  for (const ViewTarget& s : h.used) id = std::max(id, IdOf(s));
  std::vector<Near> near;
  for (std::size_t c = camera; c < cameras_.size(); ++c) {
    if (std::any_of(h.used.begin(), h.used.end(),
                    [&](const ViewTarget& s) { return s.camera == static_cast<int>(c); })) {
      continue;
    }
    Eigen::Vector2d xy;
    Eigen::Matrix<double, 2, 3> by;
    if (!cameras_[c].Project(h.point.position_mm, &xy, &by)) continue;
    const bool in_view = cameras_[c].InPicture(xy);
    NearTargets(h.point, c, id, *free_, &near, &xy, &by);
    double share = 0;
    for (const ViewTarget& s : h.used) {
      share += statistics_->seen(static_cast<Eigen::Index>(c), s.camera) /
               static_cast<double>(h.used.size());
    }
    const double miss = in_view ? std::log(1 - share + kMergedShare * share) : 0.0;
    double best_gain = -1e9;
    for (std::size_t k = 0; k < std::min<std::size_t>(near.size(), 3); ++k) {
      const double gain = std::log(share) - kLogTwoPi - 0.5 * near[k].log_det -
                          0.5 * near[k].distance2 - statistics_->log_lone[c];
      const double against = gain - miss;
      if (against < -3 || (k > 0 && gain < best_gain - 9)) continue;
      if (k > 0 && leaves_ >= kMaxLeaves) break;
      best_gain = std::max(best_gain, gain);
      Hypothesis with = h;
      with.used.push_back({static_cast<int>(c), near[k].target});
      with.score += gain;
      if (AdjustPoint(cameras_, targets_, with.used, &with.point)) {
        GrowFrom(std::move(with), c + 1);
      }
    }
    if (best_gain - miss > kSureGain || (best_gain > -1e8 && leaves_ >= kMaxLeaves)) return;
    h.score += miss;
    if (in_view && h.score < kHopeless - 6) {
      // A pair that so many cameras deny is no point; a larger set is emitted as it is.
      if (h.used.size() == 2) return;
    }
  }
  ++leaves_;
  Emit(std::move(h.used));
}

void CandidateFinder::Emit(std::vector<ViewTarget> used) {
  std::sort(used.begin(), used.end(),
            [](const ViewTarget& p, const ViewTarget& q) { return p.camera < q.camera; });
  Candidate candidate;
  while (used.size() >= 2) {
    if (sets_.contains(Key(used))) return;
    if (Make(used, &candidate)) break;
    if (used.size() == 2 || candidate.point.information.isZero()) return;
    // Without the target that fits worst.
    std::size_t worst = 0;
    double most = -1;
    for (std::size_t k = 0; k < used.size(); ++k) {
      const auto c = static_cast<std::size_t>(used[k].camera);
      const auto t = static_cast<std::size_t>(used[k].target);
      Eigen::Vector2d xy;
      if (!cameras_[c].Project(candidate.point.position_mm, &xy)) continue;
      const Eigen::Vector2d r = targets_[c].xy(t) - xy;
      const double chi2 = r.dot(targets_[c].weight(t) * r);
      if (chi2 > most) {
        most = chi2;
        worst = k;
      }
    }
    used.erase(used.begin() + static_cast<std::ptrdiff_t>(worst));
  }
  if (used.size() < 2) return;
  candidate.score = statistics_->Score(candidate);
  if (candidate.score < kHopeless) return;
  sets_.insert(Key(used));
  if (candidate.size() > 2) {
    for (std::size_t i = 0; i < used.size(); ++i) {
      for (std::size_t j = i + 1; j < used.size(); ++j) pairs_.insert(Key(used[i], used[j]));
    }
  }
  if (candidate.size() >= kSettledCameras && candidate.score > kSettledScore) {
    for (const ViewTarget& s : used) {
      settled_[static_cast<std::size_t>(s.camera)][static_cast<std::size_t>(s.target)] = 1;
    }
  }
  found_.push_back(std::move(candidate));
}

// Where two sets claim a target, either may be right without it.
void CandidateFinder::AddParts() {
  std::vector<std::vector<int>> claims;
  for (const auto& f : *free_) claims.emplace_back(f.size(), 0);
  const auto claim = [&](const ViewTarget& s) -> int& {
    return claims[static_cast<std::size_t>(s.camera)][static_cast<std::size_t>(s.target)];
  };
  for (const Candidate& c : found_) {
    for (const ViewTarget& s : c.used) ++claim(s);
  }
  const std::size_t whole = found_.size();
  for (std::size_t k = 0; k < whole; ++k) {
    if (found_[k].size() < 3) continue;
    const std::vector<ViewTarget> used = found_[k].used;
    std::vector<std::size_t> contested;
    for (std::size_t i = 0; i < used.size(); ++i) {
      if (claim(used[i]) > 1) contested.push_back(i);
    }
    if (contested.size() > kMaxContested) contested.resize(kMaxContested);
    for (unsigned mask = 1; mask < (1U << contested.size()); ++mask) {
      std::vector<ViewTarget> part;
      for (std::size_t i = 0; i < used.size(); ++i) {
        const auto place = std::find(contested.begin(), contested.end(), i) - contested.begin();
        if (place < std::ssize(contested) && ((mask >> place) & 1U)) continue;
        part.push_back(used[i]);
      }
      if (part.size() < 2 || sets_.contains(Key(part))) continue;
      Candidate candidate;
      if (!Make(part, &candidate)) continue;
      candidate.score = statistics_->Score(candidate);
      if (candidate.score < kHopeless) continue;
      sets_.insert(Key(part));
      found_.push_back(std::move(candidate));
    }
  }
}

void CandidateFinder::Grow(const std::vector<std::vector<char>>& free,
                           const StageStatistics& statistics, Candidate* candidate) const {
  std::vector<Near> near;
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    if (!((candidate->in_view >> c) & 1U)) continue;
    Eigen::Vector2d xy;
    Eigen::Matrix<double, 2, 3> by;
    if (!cameras_[c].Project(candidate->point.position_mm, &xy, &by)) continue;
    NearTargets(candidate->point, c, candidate->id, free, &near, &xy, &by);
    if (near.size() != 1) continue;
    const double gain =
        -kLogTwoPi - 0.5 * near[0].log_det - 0.5 * near[0].distance2 - statistics.log_lone[c];
    if (gain < kSureGain) continue;
    std::vector<ViewTarget> used = candidate->used;
    used.push_back({static_cast<int>(c), near[0].target});
    std::sort(used.begin(), used.end(),
              [](const ViewTarget& p, const ViewTarget& q) { return p.camera < q.camera; });
    Candidate larger;
    if (Make(used, &larger)) *candidate = std::move(larger);
  }
}

}  // namespace videogrammetry
