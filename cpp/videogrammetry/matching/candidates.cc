#include "videogrammetry/matching/candidates.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numbers>

namespace videogrammetry {
namespace {

// Two pictures within this many semi-axes of one another may be one target.
constexpr double kMergeAxes = 2.5;
// Targets of this many times the usual size would widen every look about.
constexpr double kLarge = 3.0;

std::uint64_t Mix(std::uint64_t x) {  // SplitMix64
  x += 0x9e3779b97f4a7c15U;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebU;
  return x ^ (x >> 31);
}

std::uint64_t Key(const ViewTarget& s) {
  return Mix((static_cast<std::uint64_t>(s.camera) << 32) | static_cast<std::uint32_t>(s.target));
}

// One-sided normal quantile of the two-sided level of z, for z in the range used.
double OneSided(double z) {
  const double level = std::erfc(z / std::numbers::sqrt2);
  double one_sided = z;
  for (int i = 0; i < 30; ++i) {
    const double p = 0.5 * std::erfc(one_sided / std::numbers::sqrt2);
    const double slope = std::exp(-0.5 * one_sided * one_sided) / std::sqrt(2 * std::numbers::pi);
    if (!(slope > 0)) break;
    const double before = one_sided;
    one_sided += (p - level) / slope;
    if (one_sided == before) break;
  }
  return one_sided;
}

}  // namespace

std::uint64_t SetKey(std::span<const ViewTarget> used) {
  std::uint64_t key = 0;
  for (const ViewTarget& s : used) key += Key(s);
  return key;
}

std::uint64_t SetKey(const ViewTarget& a, const ViewTarget& b) { return Key(a) + Key(b); }

double ChiSquareLimit(int dof, double z) {
  if (dof == 1) return z * z;
  // Every stage asks for the same.
  thread_local double last_z = 0.0, one_sided = 0.0;
  if (z != last_z) {
    one_sided = OneSided(z);
    last_z = z;
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
  // One logarithm of the product: 64 factors of 0.005 are far from the least number.
  double product = 1;
  for (const ViewTarget& s : candidate.used) {
    double share = 0;
    for (const ViewTarget& o : candidate.used) {
      if (o.camera != s.camera) share += seen(s.camera, o.camera);
    }
    product *= share / others;
    score -= log_lone[static_cast<std::size_t>(s.camera)];
  }
  for (std::uint64_t left = candidate.in_view; left != 0; left &= left - 1) {
    const int c = std::countr_zero(left);
    double share = 0;
    for (const ViewTarget& o : candidate.used) share += seen(c, o.camera);
    share /= others + 1;
    const bool covered = (candidate.covered >> c) & 1U;
    product *= 1 - share + (covered ? kMergedShare * share : 0.0);
  }
  return score + std::log(product);
}

CandidateMaker::CandidateMaker(const std::vector<CameraView>& cameras,
                               const std::vector<TargetView>& targets,
                               std::span<const CameraTargets> data, const MatchingOptions& options,
                               const MatchEdits& edits)
    : cameras_(cameras), targets_(targets), data_(data), options_(options) {
  for (const auto& [a, b] : edits.apart) apart_.insert(SetKey(a, b));
  chi2_limit_.resize(2 * std::max<std::size_t>(cameras.size(), 2));
  for (std::size_t d = 1; d < chi2_limit_.size(); ++d) {
    chi2_limit_[d] = ChiSquareLimit(static_cast<int>(d), options.critical_value);
  }
  usual_reach_.resize(cameras.size());
  large_.resize(cameras.size());
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    std::vector<double> semi = data[c].semi_major_px;
    if (semi.empty()) continue;
    const auto middle = semi.begin() + static_cast<std::ptrdiff_t>(semi.size() / 2);
    std::nth_element(semi.begin(), middle, semi.end());
    const double limit = kLarge * std::max(*middle, 0.0);
    double usual = 0;
    for (std::size_t t = 0; t < data[c].size(); ++t) {
      const double a = data[c].semi_major_px[t];
      if (a > limit) {
        if (targets[c].valid(t)) large_[c].push_back(static_cast<int>(t));
      } else {
        usual = std::max(usual, a);
      }
    }
    usual_reach_[c] = kMergeAxes * usual / cameras[c].f_px();
  }
}

bool CandidateMaker::KeptApart(std::span<const ViewTarget> used) const {
  if (apart_.empty()) return false;
  for (std::size_t i = 0; i < used.size(); ++i) {
    for (std::size_t j = i + 1; j < used.size(); ++j) {
      if (apart_.contains(SetKey(used[i], used[j]))) return true;
    }
  }
  return false;
}

// Diameter of the dot in mm that each camera's ellipse implies: its major axis
// is not foreshortened, so 2 a Z / f agrees between the cameras.
bool CandidateMaker::SizesAgree(const Candidate& candidate) const {
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

bool CandidateMaker::InRange(const Candidate& candidate) const {
  if (options_.min_distance_mm <= 0 && options_.max_distance_mm <= 0) return true;
  for (const ViewTarget& s : candidate.used) {
    const Eigen::Vector3d& center = cameras_[static_cast<std::size_t>(s.camera)].center();
    const double distance = (candidate.point.position_mm - center).norm();
    if (options_.min_distance_mm > 0 && distance < options_.min_distance_mm) return false;
    if (options_.max_distance_mm > 0 && distance > options_.max_distance_mm) return false;
  }
  return true;
}

bool CandidateMaker::Make(std::span<const ViewTarget> used, Candidate* candidate, bool forced,
                          const PointEstimate* known, bool look) const {
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
  if (known != nullptr) {
    candidate->point = *known;
  } else {
    candidate->point = {};
    bool met = false;
    for (std::size_t k = 1; k < used.size() && !met; ++k) {
      met = MeetingPoint(targets_[static_cast<std::size_t>(used[0].camera)],
                         static_cast<std::size_t>(used[0].target),
                         targets_[static_cast<std::size_t>(used[k].camera)],
                         static_cast<std::size_t>(used[k].target), &candidate->point.position_mm);
    }
    if (!met || !AdjustPoint(cameras_, targets_, used, &candidate->point)) return false;
  }
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
  if (look) Look(candidate);
  return true;
}

void CandidateMaker::Look(Candidate* candidate) const {
  std::array<Eigen::Vector2d, 64> place;
  std::uint64_t own = 0, in_view = 0;
  for (const ViewTarget& s : candidate->used) own |= std::uint64_t{1} << s.camera;
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    if ((own >> c) & 1U) continue;
    if (!cameras_[c].Project(candidate->point.position_mm, &place[c])) continue;
    if (cameras_[c].InPicture(place[c])) in_view |= std::uint64_t{1} << c;
  }
  LookAt(in_view, place, candidate);
}

void CandidateMaker::LookAt(std::uint64_t in_view, std::span<const Eigen::Vector2d> place,
                            Candidate* candidate) const {
  candidate->in_view = in_view;
  candidate->covered = 0;
  for (std::uint64_t left = in_view; left != 0; left &= left - 1) {
    const auto c = static_cast<std::size_t>(std::countr_zero(left));
    const Eigen::Vector2d& xy = place[c];
    bool covered = false;
    const auto look = [&](std::size_t t) {
      const double limit = kMergeAxes * data_[c].semi_major_px[t] / cameras_[c].f_px();
      covered |= limit > 0 && (targets_[c].xy(t) - xy).squaredNorm() < limit * limit;
    };
    const Eigen::Vector2d reach = Eigen::Vector2d::Constant(usual_reach_[c]);
    targets_[c].ForBox(xy - reach, xy + reach, look);
    for (const int t : large_[c]) look(static_cast<std::size_t>(t));
    if (covered) candidate->covered |= std::uint64_t{1} << c;
  }
}

void CandidateMaker::Near(const Eigen::Vector2d& xy, const Eigen::Matrix<double, 2, 3>& by,
                          const Eigen::Matrix3d& cov_mm2, std::size_t c, int id,
                          const FreeTargets& free, std::vector<NearTarget>* near) const {
  near->clear();
  const TargetView& view = targets_[c];
  const double gate = options_.critical_value * options_.critical_value + 2.0;
  const Eigen::Matrix2d predicted = by * cov_mm2 * by.transpose();
  const double widest = view.max_sigma() * view.max_sigma();
  const Eigen::Vector2d reach = (gate * (predicted.diagonal().array() + widest)).sqrt();
  view.ForBox(xy - reach, xy + reach, [&](std::size_t k) {
    if (!free[c][k] || !view.valid(k) || !IdsAgree(id, data_[c].id[k])) return;
    const Eigen::Vector2d away = view.xy(k) - xy;
    const Eigen::Matrix2d total = predicted + view.cov(k);
    const double determinant = total.determinant();
    const double scaled = total(1, 1) * away.x() * away.x() + total(0, 0) * away.y() * away.y() -
                          2 * total(0, 1) * away.x() * away.y();
    if (scaled < gate * determinant) {
      near->push_back({scaled / determinant, std::log(determinant), static_cast<int>(k)});
    }
  });
  std::sort(near->begin(), near->end(), [](const NearTarget& p, const NearTarget& q) {
    return p.distance2 != q.distance2 ? p.distance2 < q.distance2 : p.target < q.target;
  });
}

void CandidateMaker::Grow(const FreeTargets& free, const StageStatistics& statistics,
                          Candidate* candidate) const {
  std::vector<NearTarget> near;
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    if (!((candidate->in_view >> c) & 1U)) continue;
    Eigen::Vector2d xy;
    Eigen::Matrix<double, 2, 3> by;
    if (!cameras_[c].Project(candidate->point.position_mm, &xy, &by)) continue;
    Near(xy, by, candidate->point.cov_mm2(), c, candidate->id, free, &near);
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
