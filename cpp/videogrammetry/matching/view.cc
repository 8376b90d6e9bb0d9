#include "videogrammetry/matching/view.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace videogrammetry {
namespace {

constexpr int kMaxIterations = 10;
// Chi2 is quadratic about its minimum: a last step of 0.01 sigma leaves 1e-4 of it, and
// the step itself is taken.
constexpr double kLastStep = 1e-4;
// Targets this much less sure than the median would widen every search.
constexpr double kWide = 4.0;

// Inverse and determinant of a symmetric matrix by its adjoint.
Eigen::Matrix3d SymmetricInverse(const Eigen::Matrix3d& m, double* determinant) {
  const double a = m(1, 1) * m(2, 2) - m(1, 2) * m(1, 2);
  const double b = m(0, 2) * m(1, 2) - m(0, 1) * m(2, 2);
  const double c = m(0, 1) * m(1, 2) - m(0, 2) * m(1, 1);
  *determinant = m(0, 0) * a + m(0, 1) * b + m(0, 2) * c;
  Eigen::Matrix3d inverse;
  inverse(0, 0) = a;
  inverse(0, 1) = inverse(1, 0) = b;
  inverse(0, 2) = inverse(2, 0) = c;
  inverse(1, 1) = m(0, 0) * m(2, 2) - m(0, 2) * m(0, 2);
  inverse(1, 2) = inverse(2, 1) = m(0, 1) * m(0, 2) - m(0, 0) * m(1, 2);
  inverse(2, 2) = m(0, 0) * m(1, 1) - m(0, 1) * m(0, 1);
  return inverse / *determinant;
}

}  // namespace

CameraView::CameraView(const OrientedCamera& oriented)
    : oriented_(&oriented),
      rotation_(oriented.cam_from_world.rotation),
      translation_(oriented.cam_from_world.translation_mm),
      center_(oriented.center_in_world()) {
  const Camera& camera = oriented.camera;
  const double w = camera.width_px - 1, h = camera.height_px - 1;
  const Eigen::Vector2d middle[] = {{0, h / 2}, {w, h / 2}, {w / 2, 0}, {w / 2, h}};
  Eigen::Vector2d ends[4];
  for (int k = 0; k < 4; ++k) {
    const auto ray = RayThroughPixel(camera, middle[k]);
    ends[k] = ray ? Eigen::Vector2d(ray->head<2>())
                  : Eigen::Vector2d((middle[k] - camera.principal_point_px()) / camera.f_px());
  }
  low_ = {ends[0].x(), ends[2].y()};
  high_ = {ends[1].x(), ends[3].y()};
}

bool CameraView::Project(const Eigen::Vector3d& position_mm, Eigen::Vector2d* xy,
                         Eigen::Matrix<double, 2, 3>* by_position) const {
  Eigen::Vector3d seen = position_mm;
  RefractionJacobians window;
  if (oriented_->interface) {
    const auto through = SeenThrough(*oriented_->interface, position_mm, center_,
                                     by_position != nullptr ? &window : nullptr);
    if (!through) return false;
    seen = *through;
  }
  const Eigen::Vector3d p = rotation_ * seen + translation_;
  if (!(p.z() > 0)) return false;
  const double inverse = 1.0 / p.z();
  *xy = p.head<2>() * inverse;
  if (by_position != nullptr) {
    by_position->row(0) = (rotation_.row(0) - xy->x() * rotation_.row(2)) * inverse;
    by_position->row(1) = (rotation_.row(1) - xy->y() * rotation_.row(2)) * inverse;
    if (oriented_->interface) *by_position *= window.by_point;
  }
  return true;
}

void TargetView::Set(const CameraView& camera, std::span<const Eigen::Vector2d> xy_px,
                     std::span<const Eigen::Matrix2d> cov_px2) {
  const std::size_t n = xy_px.size();
  window_ = camera.has_window();
  has_grid_ = false;
  center_ = camera.center();
  xy_.resize(n);
  cov_.resize(n);
  weight_.resize(n);
  sigma_.resize(n);
  valid_.assign(n, 0);
  direction_.resize(n);
  if (window_) {
    origin_.resize(n);
    origin_by_.resize(n);
    direction_by_.resize(n);
  }
  const Eigen::Matrix3d to_world = camera.rotation().transpose();
  for (std::size_t i = 0; i < n; ++i) {
    Eigen::Matrix2d by_pixel;
    const auto ray = RayThroughPixel(camera.oriented().camera, xy_px[i], &by_pixel);
    if (!ray) continue;
    xy_[i] = ray->head<2>();
    cov_[i] = by_pixel * cov_px2[i] * by_pixel.transpose();
    const double determinant = cov_[i].determinant();
    if (!(determinant > 0) || !std::isfinite(determinant)) continue;
    weight_[i] = cov_[i].inverse();
    sigma_[i] = std::sqrt(cov_[i].diagonal().maxCoeff());
    direction_[i] = to_world * *ray;
    if (window_) {
      Eigen::Matrix<double, 3, 2> direction, origin;
      const auto refracted = RayFromPixel(camera.oriented(), xy_px[i], &direction, &origin);
      if (!refracted) continue;
      const Eigen::Matrix2d by_xy = by_pixel.inverse();
      direction_[i] = refracted->direction;
      origin_[i] = refracted->origin_mm;
      direction_by_[i] = direction * by_xy;
      origin_by_[i] = origin * by_xy;
    }
    valid_[i] = 1;
  }
}

void TargetView::MakeGrid() {
  if (has_grid_) return;
  has_grid_ = true;
  wide_.clear();
  order_.clear();
  log_det_.resize(size());
  columns_ = rows_ = 0;
  max_sigma_ = 0;
  for (std::size_t i = 0; i < size(); ++i) {
    if (!valid_[i]) continue;
    order_.push_back(static_cast<int>(i));
    log_det_[i] = std::log(cov_[i].determinant());
  }
  if (order_.empty()) return;
  auto middle = order_.begin() + static_cast<std::ptrdiff_t>(order_.size() / 2);
  std::nth_element(order_.begin(), middle, order_.end(), [&](int a, int b) {
    return sigma_[static_cast<std::size_t>(a)] < sigma_[static_cast<std::size_t>(b)];
  });
  const double limit = kWide * sigma_[static_cast<std::size_t>(*middle)];
  order_.clear();
  Eigen::Vector2d high = Eigen::Vector2d::Constant(-1e300);
  low_ = -high;
  for (std::size_t i = 0; i < size(); ++i) {
    if (!valid_[i]) continue;
    if (sigma_[i] > limit) {
      wide_.push_back(static_cast<int>(i));
      continue;
    }
    order_.push_back(static_cast<int>(i));
    max_sigma_ = std::max(max_sigma_, sigma_[i]);
    low_ = low_.cwiseMin(xy_[i]);
    high = high.cwiseMax(xy_[i]);
  }
  // About one target a cell.
  const int side = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(order_.size()))));
  columns_ = rows_ = side;
  cell_ = ((high - low_) / side).cwiseMax(1e-9);
  start_.assign(static_cast<std::size_t>(side) * static_cast<std::size_t>(side) + 1, 0);
  cell_of_.resize(order_.size());
  for (std::size_t k = 0; k < order_.size(); ++k) {
    const Eigen::Vector2d& xy = xy_[static_cast<std::size_t>(order_[k])];
    cell_of_[k] = Cell(xy.y(), 1) * side + Cell(xy.x(), 0);
    ++start_[static_cast<std::size_t>(cell_of_[k]) + 1];
  }
  for (std::size_t k = 1; k < start_.size(); ++k) start_[k] += start_[k - 1];
  std::vector<int> sorted(order_.size());
  for (std::size_t k = order_.size(); k-- > 0;) {
    // From the last one on: start_ ends as the beginnings.
    sorted[--start_[static_cast<std::size_t>(cell_of_[k]) + 1]] = order_[k];
  }
  // Each entry now is the beginning of the cell before it: shift back.
  for (std::size_t k = 1; k < start_.size(); ++k) start_[k - 1] = start_[k];
  start_.back() = sorted.size();
  order_.swap(sorted);
}

Eigen::Matrix3d PointEstimate::cov_mm2() const {
  double determinant;
  return SymmetricInverse(information, &determinant);
}

bool MeetingPoint(const TargetView& a, std::size_t i, const TargetView& b, std::size_t j,
                  Eigen::Vector3d* position_mm) {
  // Least distance of o_a + s u and o_b + t v.
  const Eigen::Vector3d u = a.direction(i), v = b.direction(j);
  const Eigen::Vector3d oa = a.origin(i), ob = b.origin(j), w = oa - ob;
  const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), uw = u.dot(w), vw = v.dot(w);
  const double determinant = uu * vv - uv * uv;
  if (!(determinant > 1e-12 * uu * vv)) return false;
  const double s = (uv * vw - vv * uw) / determinant, t = (uu * vw - uv * uw) / determinant;
  if (!(s > 0) || !(t > 0)) return false;
  *position_mm = 0.5 * (oa + s * u + ob + t * v);
  return true;
}

bool AdjustPoint(const std::vector<CameraView>& cameras, const std::vector<TargetView>& targets,
                 std::span<const ViewTarget> used, PointEstimate* point) {
  Eigen::Vector3d position = point->position_mm;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    double chi2 = 0, scale = 0;
    for (const ViewTarget& s : used) {
      const TargetView& view = targets[static_cast<std::size_t>(s.camera)];
      const auto t = static_cast<std::size_t>(s.target);
      Eigen::Vector2d xy;
      Eigen::Matrix<double, 2, 3> by;
      if (!cameras[static_cast<std::size_t>(s.camera)].Project(position, &xy, &by)) return false;
      const Eigen::Vector2d residual = view.xy(t) - xy;
      const Eigen::Vector2d weighted = view.weight(t) * residual;
      const Eigen::Matrix<double, 2, 3> heavy = view.weight(t) * by;
      normal.noalias() += by.transpose() * heavy;
      right.noalias() += by.transpose() * weighted;
      chi2 += residual.dot(weighted);
      scale = std::max(scale, by.squaredNorm());
    }
    double determinant;
    const Eigen::Matrix3d inverse = SymmetricInverse(normal, &determinant);
    if (!(determinant > 0)) return false;
    const Eigen::Vector3d step = inverse * right;
    if (!step.allFinite()) return false;
    position += step;
    const double gain = step.dot(right);
    // Of the residuals' change, the share step / distance is not linear.
    if (gain < kLastStep || gain * scale * step.squaredNorm() < kLastStep) {
      point->position_mm = position;
      point->information = normal;
      point->chi2 = std::max(chi2 - gain, 0.0);
      return true;
    }
  }
  return false;
}

}  // namespace videogrammetry
