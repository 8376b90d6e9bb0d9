#include "videogrammetry/recognition/edge_pair_region.h"

#include <algorithm>
#include <bit>
#include <cstdlib>

namespace videogrammetry::edge_pair {
namespace {

/// Sides allowed beyond those of the bounding box, for the smallest regions.
constexpr int kSlack = 6;
/// Pixels by which noise, or a hole in the border, may move an end of a row outwards.
constexpr int kLeastJump = 4;
/// Pixels that both ends of a small area's rows may go beyond their way out and back.
constexpr int kMostExcess = 6;
/// Rows that an area as long as its start is looked at in at first.
constexpr int kRowsALength = 8;
/// Least EllipseLikeness() by those rows.
constexpr double kRoughLikeness = 0.85;
/// Rows between two looks at the limits; a power of two.
constexpr int kCheckEvery = 8;

/// Bits first ... last.
std::uint64_t Span(int first, int last) {
  return (~std::uint64_t{0} >> (63 - last)) & (~std::uint64_t{0} << first);
}

}  // namespace

RegionGrower::RegionGrower(const SampleRows& rows, int max_extent_px)
    : rows_(rows),
      max_extent_(max_extent_px),
      reach_(max_extent_px + max_extent_px / kRowsALength + 1),
      left_ends_(2 * static_cast<std::size_t>(reach_) + 1) {}

bool RegionGrower::Grow(int x, int y, int level, int length_px) {
  level_ = level;
  // The word's window has the pixel in its middle, and its ends in the picture.
  window_ = std::max(0, std::min(x - 32, rows_.width - 64)) & ~1;
  wide_ = false;
  step_ = RoughStep(length_px);
  for (;;) {
    const Next end = Area(x, y);
    if (end == Next::kWider) {
      // A few rows first: clutter on bright ground comes this far.
      wide_ = true;
      step_ = std::max(step_, RoughStep(right_ - left_ + 1));
    } else if (step_ == 1) {
      return end == Next::kEnd && !IsRagged();
    } else {
      if (end != Next::kEnd || !MayBeEllipse()) return false;
      step_ = 1;
    }
  }
}

int RegionGrower::RoughStep(int length_px) const {
  return std::clamp(length_px / kRowsALength, 1, reach_ - max_extent_);
}

bool RegionGrower::MayBeEllipse() const {
  if (bottom_ - top_ < kRowsALength * step_) return true;  // too few rows to tell
  ContourMoments moments = Moments();
  moments.area *= step_;
  return EllipseLikeness(moments) >= kRoughLikeness;
}

void RegionGrower::Restart(int x, int y) {
  x0_ = x;
  y0_ = y;
  n_ = sx2_ = sy_ = sxx12_ = sxy2_ = syy_ = 0;
  sideways_ = 0;
  left_ = right_ = x;
  top_ = bottom_ = y;
  block_.count = 0;
}

RegionGrower::Next RegionGrower::Area(int x, int y) {
  Restart(x, y);
  Run start;
  const Next first = Row(y, 1, {x, x}, &start);
  if (first != Next::kRun) return first == Next::kWider ? first : Next::kFailed;
  Add(y, start);
  // Downwards first: should the area be refused, the rows to come know its border.
  const Next below = Walk(1, start);
  return below == Next::kEnd ? Walk(-1, start) : below;
}

RegionGrower::Next RegionGrower::Walk(int direction, Run last) {
  // How far the row before went beyond the one before it, on its worse side. The ends of
  // a convex area go outwards less and less; what the first row may do, the start's
  // length says: a chord near the top of a flat ellipse.
  int outwards = direction > 0 ? (last.right - last.left) / 4 : 0;
  // Convex ends go outwards once and come back once; whatever they go beyond that is
  // excess.
  const Run start = last;
  int least = start.left, most_right = start.right, travelled = 0;
  for (int y = y0_ + direction * step_;; y += direction * step_) {
    if (y < 0 || y >= rows_.height) return Next::kFailed;  // cut by the picture's border
    Run run;
    const Next next = Row(y, direction, last, &run);
    if (next == Next::kEnd) sideways_ += last.right - last.left + 1;
    if (next == Next::kEnd || next == Next::kFailed) return next;
    const int to_left = last.left - run.left, to_right = run.right - last.right;
    const int most =
        std::max(0, outwards) + kLeastJump + (last.right - last.left) / (step_ == 1 ? 8 : 2);
    outwards = std::max(to_left, to_right);
    if (outwards > most) return Next::kFailed;
    if (next == Next::kWider) return next;
    travelled += std::abs(to_left) + std::abs(to_right);
    sideways_ += std::abs(to_left) + std::abs(to_right);
    least = std::min(least, run.left);
    most_right = std::max(most_right, run.right);
    const int straight =
        start.left + run.left - 2 * least + 2 * most_right - start.right - run.right;
    if (travelled - straight > kMostExcess + std::abs(y - y0_) / 8) {
      return Next::kFailed;
    }
    Add(y, run);
    if (step_ > 1) FillBetween(y, direction, last, run);
    if (right_ - left_ >= max_extent_ || bottom_ - top_ >= max_extent_) return Next::kFailed;
    if (step_ == 1 && (y & (kCheckEvery - 1)) == 0 && IsRagged()) return Next::kFailed;
    last = run;
  }
}

// The left ends in the rows passed over.
void RegionGrower::FillBetween(int y, int direction, const Run& last, const Run& run) {
  for (int i = 1; i < step_; ++i) {
    left_ends_[static_cast<std::size_t>(y - direction * i - y0_ + reach_)] =
        run.left + (last.left - run.left) * i / step_;
  }
}

RegionGrower::Next RegionGrower::Row(int y, int direction, const Run& last, Run* run) {
  const Next next = wide_ ? WideRow(y, last, run) : NarrowRow(y, direction, last, run);
  const bool cut = next == Next::kRun && (run->left == 0 || run->right == rows_.width - 1);
  return cut ? Next::kFailed : next;
}

RegionGrower::Next RegionGrower::NarrowRow(int y, int direction, const Run& last, Run* run) {
  int row = (y - block_.first) / step_;
  if (y < block_.first || row >= block_.count) {
    const int left = direction > 0 ? rows_.height - 1 - y : y;
    block_.count = std::min(kBlock, left / step_ + 1);
    row = direction > 0 ? 0 : block_.count - 1;
    block_.first = y - row * step_;
    rows_.Mask(window_, block_.first, step_, block_.count, level_, block_.masks.data());
  }
  const std::uint64_t mask = block_.masks[static_cast<std::size_t>(row)];
  const std::uint64_t touching = mask & Span(last.left - window_, last.right - window_);
  if (touching == 0) return Next::kEnd;
  const int first = std::countr_zero(touching), final = 63 - std::countl_zero(touching);
  // The nearest clear bits beyond.
  const std::uint64_t below = ~mask & ~(~std::uint64_t{0} << first);
  const std::uint64_t above = ~mask & (~std::uint64_t{0} << final) & ~(std::uint64_t{1} << final);
  const int left = 64 - std::countl_zero(below), right = std::countr_zero(above) - 1;
  *run = {window_ + left, window_ + right};
  // At the window's end, but not the picture's, there may be more.
  if (run->right - run->left >= max_extent_) return Next::kFailed;
  const bool more = (left == 0 && window_ > 0) || (right == 63 && run->right + 1 < rows_.width);
  return more ? Next::kWider : Next::kRun;
}

std::uint64_t RegionGrower::Word(int y, int x) const {
  std::uint64_t word;
  rows_.Mask(x, y, 1, 1, level_, &word);
  return word;
}

RegionGrower::Next RegionGrower::WideRow(int y, const Run& last, Run* run) const {
  // Words begin at multiples of 64. The row's ends are looked for from both sides.
  const auto within = [&](int x) {
    return Span(std::max(0, last.left - x), std::min(63, last.right - x));
  };
  int x = last.left & ~63;
  std::uint64_t word = Word(y, x), hit = word & within(x);
  while (hit == 0) {
    x += 64;
    if (x > last.right) return Next::kEnd;
    word = Word(y, x);
    hit = word & within(x);
  }
  const int first = x + std::countr_zero(hit), least = first - max_extent_;
  *run = {0, rows_.width - 1};
  std::uint64_t clear = ~word & Span(0, first - x);
  for (int at = x; at >= 0 && at + 63 >= least; at -= 64, clear = at < 0 ? 0 : ~Word(y, at)) {
    if (clear == 0) continue;
    run->left = at + 64 - std::countl_zero(clear);
    break;
  }
  int end = last.right & ~63;
  if (end != x) word = Word(y, end);
  while ((hit = word & within(end)) == 0) {
    end -= 64;
    word = Word(y, end);
  }
  const int final = end + 63 - std::countl_zero(hit), most = final + max_extent_;
  clear = ~word & Span(final - end, 63);
  for (int at = end; at <= most; at += 64, clear = at < rows_.width ? ~Word(y, at) : 0) {
    if (at >= rows_.width) break;
    if (clear == 0) continue;
    run->right = std::min(rows_.width, at + std::countr_zero(clear)) - 1;
    break;
  }
  return Next::kRun;
}

void RegionGrower::Add(int y, const Run& run) {
  left_ = std::min(left_, run.left);
  right_ = std::max(right_, run.right);
  top_ = std::min(top_, y);
  bottom_ = std::max(bottom_, y);
  left_ends_[static_cast<std::size_t>(y - y0_ + reach_)] = run.left;
  // From the run's doubled middle c: sum x = n c / 2, sum x^2 = n c^2 / 4 + n (n^2 - 1) / 12.
  const std::int64_t c = run.left + run.right - 2 * x0_, n = run.right - run.left + 1;
  const std::int64_t v = y - y0_, nc = n * c, nv = n * v;
  n_ += n;
  sx2_ += nc;
  sy_ += nv;
  sxx12_ += 3 * nc * c + n * (n * n - 1);
  sxy2_ += nc * v;
  syy_ += nv * v;
}

bool RegionGrower::IsRagged() const {
  // A convex area has as many sides as its bounding box.
  const int width = right_ - left_ + 1, height = bottom_ - top_ + 1;
  return 2 * (sideways_ + 2 * height - kSlack) > 5 * (width + height);
}

ContourMoments RegionGrower::Moments() const {
  ContourMoments m;
  m.width_px = right_ - left_ + 1;
  m.height_px = bottom_ - top_ + 1;
  const auto n = static_cast<double>(n_);
  const double mx = 0.5 * static_cast<double>(sx2_) / n, my = static_cast<double>(sy_) / n;
  m.area = n;
  m.mean_x = x0_ + mx;
  m.mean_y = y0_ + my;
  m.var_xx = static_cast<double>(sxx12_) / (12 * n) - mx * mx;
  m.var_xy = 0.5 * static_cast<double>(sxy2_) / n - mx * my;
  m.var_yy = static_cast<double>(syy_) / n - my * my;
  return m;
}

}  // namespace videogrammetry::edge_pair
