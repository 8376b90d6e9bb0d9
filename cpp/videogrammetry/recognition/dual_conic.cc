#include "videogrammetry/recognition/dual_conic.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "videogrammetry/recognition/ellipse_fit.h"

namespace videogrammetry {
namespace {

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;
using Matrix52d = Eigen::Matrix<double, 5, 2>;

/// Half the band's breadth: spreads of the edge and pixels beyond.
constexpr double kBandSpreads = 2.0, kBandPx = 0.5;
/// Least cosine between a gradient and the way to the centre.
constexpr double kLeastInward = 0.7;
/// The plateaus begin so many spreads from the edge; outside a ring begins at twice
/// the radius.
constexpr double kPlateauSpreads = 2.5, kPlateauPx = 2.0, kMostOutside = 0.7;
constexpr int kLeastPlateauPixels = 8;
constexpr double kRounding = 1.0 / 12.0;
/// Window around the contour that RefineByDualConic reads.
constexpr double kMarginPx = 6.0;
/// Standard deviation of a centre's coordinate without noise, beyond what the residuals of the
/// plateaus already say: rendered dots of 8 to 20 px at blurs of 0.6 to 0.8 px have 0.0027 px
/// RMS, the small and oblique ones more than this. Of the axes twice that.
constexpr double kSamplingPx = 0.0018;
/// A fit that leaves the start by more than this has found something else.
constexpr double kMostMovedPx = 0.5, kMostResizedPx = 0.8;

struct Pixel {
  int x, y;
  Eigen::Vector2d v;  ///< place, the start being a unit circle
  Eigen::Vector2d h;  ///< gradient there
};

/// Distance outward from the ellipse, to first order.
double Distance(const Eigen::Matrix2d& inverse, const Eigen::Vector2d& v) {
  const double radius = v.norm();
  if (radius < 1e-9) return -1e9;
  return (radius - 1.0) * radius / (inverse * v).norm();
}

std::vector<Pixel> BandPixels(const GreyWindow& window, const EllipseFrame& frame, double reach) {
  const Eigen::Matrix2d inverse = frame.shape.inverse();
  const Eigen::Vector2d half(frame.shape.row(0).norm() + reach, frame.shape.row(1).norm() + reach);
  const Eigen::Vector2d low = frame.center - half, high = frame.center + half;
  const int x0 = std::max(window.x0 + 1, static_cast<int>(std::ceil(low.x())));
  const int x1 = std::min(window.x0 + window.width - 2, static_cast<int>(std::floor(high.x())));
  const int y0 = std::max(window.y0 + 1, static_cast<int>(std::ceil(low.y())));
  const int y1 = std::min(window.y0 + window.height - 2, static_cast<int>(std::floor(high.y())));
  std::vector<Pixel> pixels;
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      const Eigen::Vector2d v = inverse * (Eigen::Vector2d(x, y) - frame.center);
      if (std::abs(Distance(inverse, v)) > reach) continue;
      const Eigen::Vector2d g(0.5 * (window(x + 1, y) - window(x - 1, y)),
                              0.5 * (window(x, y + 1) - window(x, y - 1)));
      const Eigen::Vector2d h = frame.shape * g;
      // Inward, as a bright dot's is: what points elsewhere is noise or something else.
      if (-h.dot(v) > kLeastInward * h.norm() * v.norm()) pixels.push_back({x, y, v, h});
    }
  }
  return pixels;
}

/// Eq. (1) for one pixel, times the squared length of its gradient h: alpha . x = eta
/// with x = (S_xx, S_xy, S_yy, c_x, c_y) of S - c c^T and c.
struct Tangent {
  explicit Tangent(const Pixel& pixel) : h(pixel.h), v(pixel.v) {
    length2 = h.squaredNorm();
    q = h.dot(v);
    alpha << h.x() * h.x(), 2 * h.x() * h.y(), h.y() * h.y(), 2 * q * h.x(), 2 * q * h.y();
  }
  double Residual(const Vector5d& x) const { return q * q - alpha.dot(x); }
  /// Derivative by h of what the pixel adds to the normal equations' gradient,
  /// alpha Residual / h^2.
  Matrix52d ScoreDerivative(const Vector5d& x) const {
    Matrix52d by_h;
    by_h << 2 * h.x(), 0, 2 * h.y(), 2 * h.x(), 0, 2 * h.y(), 2 * (v.x() * h.x() + q),
        2 * v.y() * h.x(), 2 * v.x() * h.y(), 2 * (v.y() * h.y() + q);
    const double residual = Residual(x);
    const Eigen::RowVector2d residual_by_h = 2 * q * v.transpose() - x.transpose() * by_h;
    return (by_h * residual + alpha * residual_by_h -
            alpha * (2.0 * residual / length2) * h.transpose()) /
           length2;
  }

  Eigen::Vector2d h, v;
  double length2, q;
  Vector5d alpha;
};

/// Mean and variance of the grey values about a plane.
struct Plateau {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  double squares = 0.0;
  int count = 0;

  void Add(const Eigen::Vector2d& v, double grey) {
    const Eigen::Vector3d row(1.0, v.x(), v.y());
    normal += row * row.transpose();
    right += row * grey;
    squares += grey * grey;
    ++count;
  }
  double mean() const { return right[0] / count; }
  std::optional<double> variance() const {
    if (count < kLeastPlateauPixels) return std::nullopt;
    const double fitted = right.dot(normal.ldlt().solve(right));
    return std::max(0.0, squares - fitted) / (count - 3);
  }
};

/// Variance of a grey value between those of the plateaus.
struct Noise {
  double grey = 0.0, at_grey = kRounding, slope = 0.0, least = kRounding;
  double Variance(double g) const { return std::max(least, at_grey + slope * (g - grey)); }
};

Noise NoiseAround(const GreyWindow& window, const TargetEdge& start, const EllipseFrame& frame) {
  const Eigen::Matrix2d inverse = frame.shape.inverse();
  const double off = kPlateauSpreads * start.width_px;
  const double end =
      std::max(off + 1.0, std::min(off + kPlateauPx, kMostOutside * start.ellipse.semi_minor_px));
  Plateau inside, outside;
  for (int y = window.y0; y < window.y0 + window.height; ++y) {
    for (int x = window.x0; x < window.x0 + window.width; ++x) {
      const Eigen::Vector2d v = inverse * (Eigen::Vector2d(x, y) - frame.center);
      const double distance = Distance(inverse, v);
      // About the plateau's own level: squares of large numbers would cancel.
      if (distance < -off) inside.Add(v, window(x, y) - start.inside);
      if (distance > off && distance < end) outside.Add(v, window(x, y) - start.outside);
    }
  }
  const auto v1 = inside.variance(), v0 = outside.variance();
  Noise noise;
  if (v1 && v0) {
    noise.grey = start.outside;
    noise.at_grey = *v0;
    noise.slope = (*v1 - *v0) / std::max(1.0, start.inside - start.outside);
    noise.least = std::max(kRounding, 0.3 * std::min(*v0, *v1));
  } else if (v1 || v0) {
    noise.at_grey = v1 ? *v1 : *v0;
  }
  return noise;
}

/// Covariance of the normal equations' gradient by the noise of every pixel.
Matrix5d ScoreCovariance(const GreyWindow& window, const std::vector<Pixel>& pixels,
                         const Eigen::Matrix2d& shape, const Vector5d& x, const Noise& noise) {
  std::vector<Vector5d> by_grey(static_cast<std::size_t>(window.width * window.height),
                                Vector5d::Zero());
  for (const Pixel& pixel : pixels) {
    // h = E g, g half the difference of two neighbours.
    const Matrix52d by_gradient = 0.5 * Tangent(pixel).ScoreDerivative(x) * shape;
    const auto at =
        static_cast<std::size_t>((pixel.y - window.y0) * window.width + pixel.x - window.x0);
    const auto below = static_cast<std::size_t>(window.width);
    by_grey[at + 1] += by_gradient.col(0);
    by_grey[at - 1] -= by_gradient.col(0);
    by_grey[at + below] += by_gradient.col(1);
    by_grey[at - below] -= by_gradient.col(1);
  }
  Matrix5d cov = Matrix5d::Zero();
  std::size_t at = 0;
  for (int y = window.y0; y < window.y0 + window.height; ++y) {
    for (int c = window.x0; c < window.x0 + window.width; ++c, ++at) {
      const Vector5d& score = by_grey[at];
      if (score[3] != 0.0 || score[4] != 0.0) {
        cov += noise.Variance(window(c, y)) * score * score.transpose();
      }
    }
  }
  return cov;
}

Eigen::Matrix2d Symmetric(double xx, double xy, double yy) {
  return (Eigen::Matrix2d() << xx, xy, xy, yy).finished();
}

/// Derivative of (c_x, c_y, E_xx, E_xy, E_yy) in the picture by x, the start's frame
/// being `start`: S = E E moves by dE E + E dE.
Matrix5d FrameJacobian(const Eigen::Matrix2d& start, const EllipseFrame& frame,
                       const Eigen::Vector2d& c) {
  const auto row = [](const Eigen::Matrix2d& m) {
    return Eigen::Vector3d(m(0, 0), m(0, 1), m(1, 1));
  };
  const Eigen::Matrix2d unit[3] = {Symmetric(1, 0, 0), Symmetric(0, 1, 0), Symmetric(0, 0, 1)};
  Eigen::Matrix3d shape2_by_shape, shape2_by_x;
  for (int i = 0; i < 3; ++i) {
    shape2_by_shape.col(i) = row(unit[i] * frame.shape + frame.shape * unit[i]);
    shape2_by_x.col(i) = row(start * unit[i] * start);
  }
  Eigen::Matrix<double, 3, 2> shape2_by_c;
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector2d e = Eigen::Vector2d::Unit(i);
    shape2_by_c.col(i) = row(start * (e * c.transpose() + c * e.transpose()) * start);
  }
  const Eigen::Matrix3d inverse = shape2_by_shape.inverse();
  Matrix5d jacobian = Matrix5d::Zero();
  jacobian.topRightCorner<2, 2>() = start;
  jacobian.bottomLeftCorner<3, 3>() = inverse * shape2_by_x;
  jacobian.bottomRightCorner<3, 2>() = inverse * shape2_by_c;
  return jacobian;
}

/// The covariance of the ellipse from that of the frame's five parameters.
Matrix5d EllipseCovariance(const EllipseFrame& frame, const Matrix5d& frame_cov) {
  const Matrix5d jacobian = frame.EllipseJacobian();
  const Matrix5d product = jacobian * frame_cov * jacobian.transpose();
  Matrix5d cov = 0.5 * (product + product.transpose());  // rounding
  cov.diagonal().head<2>().array() += kSamplingPx * kSamplingPx;
  cov.diagonal().segment<2>(2).array() += 4 * kSamplingPx * kSamplingPx;
  BoundDirection(&cov);
  return cov;
}

bool HasLeftStart(const Ellipse& start, const Ellipse& e) {
  const double moved = std::hypot(e.x_px - start.x_px, e.y_px - start.y_px);
  const double resized = std::max(std::abs(e.semi_major_px - start.semi_major_px),
                                  std::abs(e.semi_minor_px - start.semi_minor_px));
  return !(moved <= kMostMovedPx) || !(resized <= kMostResizedPx);
}

}  // namespace

std::optional<DualConicFit> FitDualConic(const GreyWindow& window, const TargetEdge& start) {
  const EllipseFrame from = EllipseFrame::From(start.ellipse);
  const auto pixels = BandPixels(window, from, kBandSpreads * start.width_px + kBandPx);
  if (pixels.size() < 20) return std::nullopt;
  Matrix5d normal = Matrix5d::Zero();
  Vector5d right = Vector5d::Zero();
  double weight = 0.0;
  for (const Pixel& pixel : pixels) {
    const Tangent t(pixel);
    normal += t.alpha * t.alpha.transpose() / t.length2;
    right += t.alpha * (t.q * t.q / t.length2);
    weight += t.length2;
  }
  const Eigen::LDLT<Matrix5d> solver(normal);
  if (solver.info() != Eigen::Success || !solver.isPositive()) return std::nullopt;
  const Vector5d x = solver.solve(right);
  if (!x.allFinite()) return std::nullopt;
  // d of unit h differs from the ellipse's by Residual / 2 in the start's units, to first
  // order; a unit along n is |E n| pixels, and |E n| |g| = |h|.
  double squares = 0.0, pixel_weight = 0.0;
  const Eigen::Matrix2d inverse = from.shape.inverse();
  for (const Pixel& pixel : pixels) {
    const Tangent t(pixel);
    const double off = 0.5 * t.Residual(x) / t.length2, slope2 = (inverse * t.h).squaredNorm();
    squares += t.length2 * off * off * t.length2 / slope2;
    pixel_weight += t.length2;
  }
  DualConicFit fit;
  fit.spread_px = std::sqrt(squares / pixel_weight);
  const Eigen::Vector2d c = x.tail<2>();
  const Eigen::Matrix2d shape2 =
      from.shape * (Symmetric(x[0], x[1], x[2]) + c * c.transpose()) * from.shape -
      fit.spread_px * fit.spread_px * Eigen::Matrix2d::Identity();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen(shape2);
  if (!(eigen.eigenvalues()[0] > 0.0)) return std::nullopt;
  const EllipseFrame frame{from.center + from.shape * c, eigen.operatorSqrt()};
  fit.ellipse = frame.ToEllipse();
  if (HasLeftStart(start.ellipse, fit.ellipse)) return std::nullopt;
  const Noise noise = NoiseAround(window, start, from);
  const Matrix5d score = ScoreCovariance(window, pixels, from.shape, x, noise);
  const Matrix5d to_frame =
      FrameJacobian(from.shape, frame, c) * solver.solve(Matrix5d::Identity());
  fit.cov = EllipseCovariance(frame, to_frame * score * to_frame.transpose());
  return fit;
}

void RefineByDualConic(const FrameView& frame, int sign, const std::vector<TargetEdge*>& edges) {
  WindowReader reader(frame, sign);
  for (TargetEdge* edge : edges) {
    const EllipseFrame e = EllipseFrame::From(edge->ellipse);
    const double half_x = e.shape.row(0).norm() + kMarginPx;
    const double half_y = e.shape.row(1).norm() + kMarginPx;
    const GreyWindow window = reader.Read(
        static_cast<int>(e.center.x() - half_x), static_cast<int>(e.center.y() - half_y),
        static_cast<int>(e.center.x() + half_x), static_cast<int>(e.center.y() + half_y));
    const auto fit = FitDualConic(window, *edge);
    if (!fit) continue;
    edge->ellipse = fit->ellipse;
    edge->cov = fit->cov;
  }
}

}  // namespace videogrammetry
