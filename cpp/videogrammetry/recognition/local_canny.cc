#include "videogrammetry/recognition/local_canny.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

namespace videogrammetry {
namespace {

/// Least cosine between an edge's normal and the ellipse's.
constexpr float kMinCosine = 0.6f;

/// The candidate's surroundings: gradients of a window of the picture.
class GradientWindow {
 public:
  template <typename T>
  GradientWindow(const SignedImage<T>& image, int x0, int y0, int width, int height)
      : x0_(x0), y0_(y0), width_(width), height_(height) {
    const std::size_t size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    gx_.resize(size);
    gy_.resize(size);
    magnitude_.resize(size);
    // Eighths of a Sobel sum: grey levels per pixel.
    const float scale = 0.125f * static_cast<float>(image.sign());
    for (int y = 0; y < height; ++y) {
      const T* up = image.row(y0 + y - 1) + x0;
      const T* mid = image.row(y0 + y) + x0;
      const T* down = image.row(y0 + y + 1) + x0;
      float* gx = &gx_[Index(0, y)];
      float* gy = &gy_[Index(0, y)];
      float* magnitude = &magnitude_[Index(0, y)];
      for (int x = 0; x < width; ++x) {
        const int sx =
            (up[x + 1] - up[x - 1]) + 2 * (mid[x + 1] - mid[x - 1]) + (down[x + 1] - down[x - 1]);
        const int sy =
            (down[x - 1] - up[x - 1]) + 2 * (down[x] - up[x]) + (down[x + 1] - up[x + 1]);
        gx[x] = scale * static_cast<float>(sx);
        gy[x] = scale * static_cast<float>(sy);
        magnitude[x] = std::sqrt(gx[x] * gx[x] + gy[x] * gy[x]);
      }
    }
  }

  std::size_t Index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(x);
  }
  int x0() const { return x0_; }
  int y0() const { return y0_; }
  int width() const { return width_; }
  int height() const { return height_; }
  float gx(std::size_t i) const { return gx_[i]; }
  float gy(std::size_t i) const { return gy_[i]; }
  float magnitude(std::size_t i) const { return magnitude_[i]; }

  /// True where no neighbour along the gradient is steeper; between two
  /// neighbours the magnitude is interpolated linearly.
  bool IsRidge(int x, int y) const {
    const std::size_t i = Index(x, y);
    const float m = magnitude_[i], ax = std::abs(gx_[i]), ay = std::abs(gy_[i]);
    const int sx = gx_[i] < 0 ? -1 : 1, sy = gy_[i] < 0 ? -1 : 1;
    const bool flat = ax >= ay;
    const float t = flat ? ay / ax : ax / ay;
    const int step_x = flat ? sx : 0, step_y = flat ? 0 : sy;
    const auto beside = [&](int sign) {
      return (1 - t) * magnitude_[Index(x + sign * step_x, y + sign * step_y)] +
             t * magnitude_[Index(x + sign * sx, y + sign * sy)];
    };
    // Equal on one side only, or a plateau would give a double edge.
    return m > beside(1) && m >= beside(-1);
  }

 private:
  int x0_, y0_, width_, height_;
  std::vector<float> gx_, gy_, magnitude_;
};

/// Implicit form of the ellipse: radius 1 on it.
struct Radius {
  explicit Radius(const Ellipse& e)
      : cx(static_cast<float>(e.x_px)), cy(static_cast<float>(e.y_px)) {
    const double c = std::cos(e.angle_rad), s = std::sin(e.angle_rad);
    const double ia = 1 / (e.semi_major_px * e.semi_major_px);
    const double ib = 1 / (e.semi_minor_px * e.semi_minor_px);
    sxx = static_cast<float>(c * c * ia + s * s * ib);
    sxy = static_cast<float>(c * s * (ia - ib));
    syy = static_cast<float>(s * s * ia + c * c * ib);
  }

  /// First and last column of the window in which the row at py is within
  /// `radius`; first > last where none is.
  std::pair<int, int> Columns(float py, float radius, const GradientWindow& window) const {
    // sxx x^2 + 2 sxy py x + syy py^2 = radius^2
    const float middle = -sxy * py / sxx;
    const float square = middle * middle - (syy * py * py - radius * radius) / sxx;
    if (!(square > 0)) return {1, 0};
    const float half = std::sqrt(square), offset = cx - static_cast<float>(window.x0());
    return {std::max(1, static_cast<int>(std::ceil(offset + middle - half))),
            std::min(window.width() - 2, static_cast<int>(std::floor(offset + middle + half)))};
  }

  float cx, cy, sxx, sxy, syy;
};

/// Edge pixels of a window; those above the high threshold come with `strong`.
struct Ridge {
  EdgePixel pixel;
  float magnitude = 0.0f;
};

std::vector<Ridge> RidgesNearEllipse(const GradientWindow& window, const Ellipse& ellipse,
                                     float band, std::vector<float>* on_ellipse) {
  const Radius shape(ellipse);
  std::vector<Ridge> ridges;
  const auto visit = [&](int x, int y) {
    const float px = static_cast<float>(x + window.x0()) - shape.cx;
    const float py = static_cast<float>(y + window.y0()) - shape.cy;
    const float nx = shape.sxx * px + shape.sxy * py, ny = shape.sxy * px + shape.syy * py;
    // First-order distance (Sampson): (q - 1) / |grad q|, q = p' S p.
    const float q = nx * px + ny * py, slope = std::sqrt(nx * nx + ny * ny);
    const float distance = 0.5f * std::abs(q - 1.0f);
    if (distance > band * slope) return;
    const std::size_t i = window.Index(x, y);
    const float m = window.magnitude(i);
    const float inward = -(window.gx(i) * nx + window.gy(i) * ny);
    if (distance < 0.75f * slope) on_ellipse->push_back(inward > 0 ? m : 0.0f);
    if (inward < kMinCosine * m * slope || !(m > 0) || !window.IsRidge(x, y)) return;
    ridges.push_back({{x + window.x0(), y + window.y0(), -window.gx(i) / m, -window.gy(i) / m}, m});
  };
  // What is within the band lies between two ellipses of the same shape.
  const float outer = 1.0f + band / static_cast<float>(ellipse.semi_minor_px);
  const float inner = std::max(0.0f, 1.0f - band / static_cast<float>(ellipse.semi_minor_px));
  for (int y = 1; y + 1 < window.height(); ++y) {
    const float py = static_cast<float>(y + window.y0()) - shape.cy;
    const auto [first, last] = shape.Columns(py, outer, window);
    const auto [hole_first, hole_last] = shape.Columns(py, inner, window);
    for (int x = first; x <= last; ++x) {
      if (x == hole_first + 1 && hole_last > x) x = hole_last;
      visit(x, y);
    }
  }
  return ridges;
}

/// Keeps ridges >= low that hang together with one >= high (8 neighbours).
std::vector<EdgePixel> Hysteresis(const GradientWindow& window, const std::vector<Ridge>& ridges,
                                  float low, float high) {
  std::vector<std::int32_t> label(
      static_cast<std::size_t>(window.width()) * static_cast<std::size_t>(window.height()), -1);
  std::vector<int> stack;
  const auto index = [&](const Ridge& r) {
    return window.Index(r.pixel.x - window.x0(), r.pixel.y - window.y0());
  };
  for (std::size_t k = 0; k < ridges.size(); ++k) {
    if (ridges[k].magnitude < low) continue;
    label[index(ridges[k])] = static_cast<std::int32_t>(k);
    if (ridges[k].magnitude >= high) stack.push_back(static_cast<int>(k));
  }
  std::vector<EdgePixel> edges;
  edges.reserve(ridges.size());
  while (!stack.empty()) {
    const Ridge& ridge = ridges[static_cast<std::size_t>(stack.back())];
    stack.pop_back();
    const std::size_t center = index(ridge);
    if (label[center] < 0) continue;  // taken already
    label[center] = -1;
    edges.push_back(ridge.pixel);
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        const std::size_t near =
            window.Index(ridge.pixel.x - window.x0() + dx, ridge.pixel.y - window.y0() + dy);
        if (label[near] >= 0) stack.push_back(label[near]);
      }
    }
  }
  return edges;
}

}  // namespace

template <typename T>
std::vector<EdgePixel> LocalCanny(const SignedImage<T>& image, const Ellipse& ellipse,
                                  double band_px) {
  const double c = std::cos(ellipse.angle_rad), s = std::sin(ellipse.angle_rad);
  const double reach_x = std::hypot(ellipse.semi_major_px * c, ellipse.semi_minor_px * s) + band_px;
  const double reach_y = std::hypot(ellipse.semi_major_px * s, ellipse.semi_minor_px * c) + band_px;
  // One pixel more for the suppression, and one again for the Sobel sums.
  const int x0 = std::max(1, static_cast<int>(std::floor(ellipse.x_px - reach_x)) - 1);
  const int y0 = std::max(1, static_cast<int>(std::floor(ellipse.y_px - reach_y)) - 1);
  const int x1 =
      std::min(image.width() - 2, static_cast<int>(std::ceil(ellipse.x_px + reach_x)) + 1);
  const int y1 =
      std::min(image.height() - 2, static_cast<int>(std::ceil(ellipse.y_px + reach_y)) + 1);
  if (x1 - x0 < 3 || y1 - y0 < 3) return {};
  const GradientWindow window(image, x0, y0, x1 - x0 + 1, y1 - y0 + 1);
  std::vector<float> on_ellipse;
  const auto ridges = RidgesNearEllipse(window, ellipse, static_cast<float>(band_px), &on_ellipse);
  if (on_ellipse.empty()) return {};
  const auto middle = on_ellipse.begin() + static_cast<std::ptrdiff_t>(on_ellipse.size() / 2);
  std::nth_element(on_ellipse.begin(), middle, on_ellipse.end());
  const float typical = *middle;
  return Hysteresis(window, ridges, 0.25f * typical, 0.5f * typical);
}

template std::vector<EdgePixel> LocalCanny(const SignedImage<std::uint8_t>&, const Ellipse&,
                                           double);
template std::vector<EdgePixel> LocalCanny(const SignedImage<std::uint16_t>&, const Ellipse&,
                                           double);

}  // namespace videogrammetry
