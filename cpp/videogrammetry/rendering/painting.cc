#include "videogrammetry/rendering/painting.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include "videogrammetry/rendering/target_pattern.h"
#include "videogrammetry/rendering/truth.h"

namespace videogrammetry {
namespace {

constexpr int kOutline = 16;

/// Pictures of points around the sticker; empty if one has none.
std::vector<Eigen::Vector2d> Outline(const OrientedCamera& camera, const SceneTarget& target,
                                     const TargetPose& pose) {
  std::vector<Eigen::Vector2d> outline;
  const double reach = target.sticker == StickerShape::kSquare
                           ? std::numbers::sqrt2 * target.sticker_mm
                           : target.sticker_mm / std::cos(std::numbers::pi / kOutline);
  if (FacingOf(camera, pose, reach) != Facing::kFront) return outline;
  for (int k = 0; k < kOutline; ++k) {
    // Points 2, 6, 10, 14 are a square's corners.
    const double angle = 2 * std::numbers::pi * k / kOutline;
    const double stretch =
        target.sticker == StickerShape::kSquare
            ? target.sticker_mm / std::max(std::abs(std::cos(angle)), std::abs(std::sin(angle)))
            : reach;
    const Eigen::Vector3d point = pose.center_mm + stretch * (std::cos(angle) * pose.x_axis +
                                                              std::sin(angle) * pose.y_axis());
    const auto pixel = ProjectFromWorld(camera, point);
    if (!pixel) return {};
    outline.push_back(*pixel);
  }
  return outline;
}

struct Way {
  int positions = 1;
  PixelWindow window;
};

double Clip(double value, double low, double high) { return std::min(std::max(value, low), high); }

/// Window of the target over the exposure, and how many positions it needs.
Way WayOf(const OrientedCamera& camera, const SceneTarget& target, int margin_px) {
  const auto begin = Outline(camera, target, target.pose);
  if (begin.empty()) return {};
  auto all = begin;
  Way way;
  if (target.end_pose) {
    const auto end = Outline(camera, target, *target.end_pose);
    if (end.empty()) return {};
    double longest = 0;
    for (int k = 0; k < kOutline; ++k) longest = std::max(longest, (end[k] - begin[k]).norm());
    if (longest > kMaxBlurPx) {
      throw std::invalid_argument("end_pose: expected a way of at most " +
                                  std::to_string(kMaxBlurPx) + " px in the picture, got " +
                                  std::to_string(longest));
    }
    way.positions = std::max(kMinBlurPositions, static_cast<int>(std::ceil(4 * longest)));
    const auto middle = Outline(camera, target, PoseAt(target, 0.5));
    all.insert(all.end(), end.begin(), end.end());
    all.insert(all.end(), middle.begin(), middle.end());
  }
  Eigen::Vector2d low = all[0], high = all[0];
  for (const Eigen::Vector2d& p : all) low = low.cwiseMin(p), high = high.cwiseMax(p);
  // Distortion may bend the outline between its points: 2 px, or 2 % of its size.
  const double spare = 2 + 0.02 * (high - low).maxCoeff();
  const Camera& c = camera.camera;
  way.window = {static_cast<int>(Clip(low.x() - spare, -margin_px, c.width_px)),
                static_cast<int>(Clip(low.y() - spare, -margin_px, c.height_px)),
                static_cast<int>(Clip(high.x() + spare + 1, -margin_px, c.width_px + margin_px)),
                static_cast<int>(Clip(high.y() + spare + 1, -margin_px, c.height_px + margin_px))};
  return way;
}

/// Colours of a target's parts, and the light's change across it.
struct Paint {
  float mark, sheet, by_u, by_v;
  bool even;

  explicit Paint(const SceneTarget& t)
      : mark(static_cast<float>(t.white_on_black ? t.white : t.black)),
        sheet(static_cast<float>(t.white_on_black ? t.black : t.white)),
        by_u(static_cast<float>(t.gradient[0])),
        by_v(static_cast<float>(t.gradient[1])),
        even(t.gradient[0] == 0 && t.gradient[1] == 0) {}
};

/// Moves a cell's centre of gravity: half of the moment to the next cell, less
/// half from the one before.
void Shift(float* cell, int step, float moment) {
  cell[step] += 0.5f * moment;
  cell[-step] -= 0.5f * moment;
}

void AddPosition(const PlaneLattice& lattice, const TargetPattern& pattern, const Paint& paint,
                 int lines, FineWindow* out) {
  const int columns = out->columns(), rows = out->rows(), n = lattice.columns;
  const bool shift = out->scale > 1;  // without a lens pixels do not mix
  for (int j = 0; j < rows; ++j) {
    const float* u = lattice.u.data() + static_cast<std::size_t>(j) * n;
    const float* v = lattice.v.data() + static_cast<std::size_t>(j) * n;
    float* cover = out->cover.data() + static_cast<std::size_t>(j) * columns;
    float* light = out->light.data() + static_cast<std::size_t>(j) * columns;
    for (int i = 0; i < columns; ++i) {
      const CellCorners cell{u[i],     v[i],     u[i + 1],     v[i + 1],
                             u[i + n], v[i + n], u[i + n + 1], v[i + n + 1]};
      const Coverage c = pattern.Over(cell, lines);
      if (!(c.sticker > 0)) continue;
      float colour = c.mark * paint.mark + (c.sticker - c.mark) * paint.sheet;
      if (!paint.even) {
        colour *= 1 + 0.25f * (paint.by_u * (cell.u00 + cell.u10 + cell.u01 + cell.u11) +
                               paint.by_v * (cell.v00 + cell.v10 + cell.v01 + cell.v11));
      }
      cover[i] += c.sticker;
      light[i] += colour;
      if (!c.cut || !shift || i == 0 || i + 1 == columns || j == 0 || j + 1 == rows) continue;
      const float tone = paint.mark - paint.sheet;
      Shift(cover + i, 1, c.sticker_x);
      Shift(cover + i, columns, c.sticker_y);
      Shift(light + i, 1, c.sticker_x * paint.sheet + c.mark_x * tone);
      Shift(light + i, columns, c.sticker_y * paint.sheet + c.mark_y * tone);
    }
  }
}

/// Mean over the positions, times the light that falls there.
void Light(const LightField& field, int positions, FineWindow* out) {
  const float share = 1.0f / static_cast<float>(positions);
  const int columns = out->columns();
  const double step = 1.0 / out->scale, first = 0.5 * step - 0.5;
  for (int j = 0; j < out->rows(); ++j) {
    const double y = out->window.y0 + first + j * step;
    const auto at_begin = static_cast<float>(share * field.At(out->window.x0 + first, y));
    const auto by_cell = static_cast<float>(share * field.by_x() * step);
    float* cover = out->cover.data() + static_cast<std::size_t>(j) * columns;
    float* light = out->light.data() + static_cast<std::size_t>(j) * columns;
    for (int i = 0; i < columns; ++i) {
      cover[i] *= share;
      light[i] *= at_begin + by_cell * static_cast<float>(i);
    }
  }
}

/// Takes from `behind` (cells of `of`) what the nearer `by` hides, and puts its light there.
void Cover(const FineWindow& by, const PixelWindow& of, std::vector<float>* behind) {
  const int s = by.scale;
  const PixelWindow both{std::max(of.x0, by.window.x0), std::max(of.y0, by.window.y0),
                         std::min(of.x1, by.window.x1), std::min(of.y1, by.window.y1)};
  for (int y = both.y0 * s; y < both.y1 * s; ++y) {
    const std::size_t to = static_cast<std::size_t>(y - of.y0 * s) * (of.width() * s);
    const std::size_t from = static_cast<std::size_t>(y - by.window.y0 * s) * by.columns();
    for (int x = both.x0 * s; x < both.x1 * s; ++x) {
      const std::size_t i = to + (x - of.x0 * s), k = from + (x - by.window.x0 * s);
      (*behind)[i] += by.light[k] - by.cover[k] * (*behind)[i];
    }
  }
}

void BackgroundCells(const std::vector<float>& raw, const PixelWindow& window, int scale, int width,
                     int height, std::vector<float>* cells) {
  cells->resize(static_cast<std::size_t>(window.width()) * window.height() * scale * scale);
  float* out = cells->data();
  for (int j = 0; j < window.height() * scale; ++j) {
    const int y = std::clamp(window.y0 + j / scale, 0, height - 1);
    const float* row = raw.data() + static_cast<std::size_t>(y) * width;
    for (int x = window.x0; x < window.x1; ++x) {
      const float value = row[std::clamp(x, 0, width - 1)];
      for (int p = 0; p < scale; ++p) *out++ = value;
    }
  }
}

}  // namespace

FineWindow PaintTarget(const OrientedCamera& camera, const SceneTarget& target,
                       const LightField& light, const PsfKernel& psf) {
  FineWindow out;
  out.scale = psf.scale();
  const Way way = WayOf(camera, target, psf.radius_px());
  out.window = way.window;
  if (out.window.empty()) return out;
  const auto count = static_cast<std::size_t>(out.columns()) * out.rows();
  out.cover.assign(count, 0.0f);
  out.light.assign(count, 0.0f);
  const TargetPattern pattern(target);
  const Paint paint(target);
  // Eight lines a pixel; fewer where several positions share the work.
  const int lines = std::max(2, (way.positions > 1 ? 4 : 8) / out.scale);
  for (int k = 0; k < way.positions; ++k) {
    const TargetPose pose = PoseAt(target, (k + 0.5) / way.positions);
    const LocalMap map(camera, pose, target.radius_mm);
    AddPosition(map.Over(out.window, out.scale), pattern, paint, lines, &out);
  }
  Light(light, way.positions, &out);
  return out;
}

void Compose(const std::vector<FineWindow>& far_to_near, const std::vector<float>& raw,
             const PsfKernel& psf, int width, int height, float* picture) {
  std::vector<float> change;
  for (std::size_t i = 0; i < far_to_near.size(); ++i) {
    const FineWindow& target = far_to_near[i];
    if (target.window.empty()) continue;
    BackgroundCells(raw, target.window, target.scale, width, height, &change);
    for (std::size_t j = 0; j < i; ++j) {
      if (far_to_near[j].window.Overlaps(target.window)) {
        Cover(far_to_near[j], target.window, &change);
      }
    }
    // What the target adds to the light, to be blurred: light - cover * behind.
    for (std::size_t k = 0; k < change.size(); ++k) {
      change[k] = target.light[k] - target.cover[k] * change[k];
    }
    psf.AddBlurred(target.window, change, width, height, picture);
  }
}

}  // namespace videogrammetry
