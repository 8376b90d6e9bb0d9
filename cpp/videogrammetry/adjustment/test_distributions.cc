#include "videogrammetry/adjustment/test_distributions.h"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>

namespace videogrammetry {
namespace {

double Bisect(double low, double high, auto&& above) {
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    (above(middle) ? high : low) = middle;
  }
  return 0.5 * (low + high);
}

/// P(|T| > t) of Student's t: the finite sums of Abramowitz & Stegun 26.7.3 and 26.7.4.
double StudentTail(double t, int degrees) {
  const double theta = std::atan2(t, std::sqrt(static_cast<double>(degrees)));
  const double cosine = std::cos(theta), square = cosine * cosine;
  double term = degrees % 2 == 1 ? cosine : 1.0, sum = degrees == 1 ? 0.0 : term;
  for (int k = degrees % 2 == 1 ? 3 : 2; k < degrees; k += 2) {
    term *= square * (k - 1) / k;
    sum += term;
  }
  const double inside = std::sin(theta) * sum;
  return degrees % 2 == 1 ? 1.0 - (theta + inside) * 2.0 / M_PI : 1.0 - inside;
}

}  // namespace

double QuadraticForm(const Eigen::Vector3d& u, const Eigen::Matrix3d& q,
                     const Eigen::Matrix3d& scale, double share) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(q);
  const Eigen::Vector3d along = eigen.eigenvectors().transpose() * u;
  double sum = 0.0;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d axis = eigen.eigenvectors().col(k);
    if (eigen.eigenvalues()[k] > share * axis.dot(scale * axis)) {
      sum += along[k] * along[k] / eigen.eigenvalues()[k];
    }
  }
  return sum;
}

double EquivalentDeviate(double t) {
  if (!(t > 0)) return 0.0;
  // Both tails' leading terms: exp(-w^2/2)/w = sqrt(t) exp(-t/2).
  if (t > 400) return std::sqrt(t - 2 * std::log(t));
  const double tail = std::erfc(std::sqrt(0.5 * t)) + std::sqrt(2 * t / M_PI) * std::exp(-0.5 * t);
  return Bisect(0.0, 25.0, [&](double w) { return std::erfc(w / std::sqrt(2.0)) < tail; });
}

double StudentQuantile(double k, int degrees) {
  // Cornish and Fisher's series, Abramowitz & Stegun 26.7.5: better than 1e-6
  // from 200 degrees on.
  if (degrees >= 200) {
    const double n = degrees, k2 = k * k;
    return k + k * (k2 + 1) / (4 * n) + k * ((5 * k2 + 16) * k2 + 3) / (96 * n * n);
  }
  const double tail = std::erfc(k / std::sqrt(2.0));
  return Bisect(0.0, 1e9, [&](double t) { return StudentTail(t, degrees) < tail; });
}

double PopeTau(double critical_value, int redundancy) {
  if (redundancy < 2) return std::numeric_limits<double>::infinity();
  const double r = redundancy, t = StudentQuantile(critical_value, redundancy - 1);
  return t * std::sqrt(r) / std::sqrt(r - 1 + t * t);
}

}  // namespace videogrammetry
