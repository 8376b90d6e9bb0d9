#include "videogrammetry/recognition/edge_pair_region.h"

#include <algorithm>
#include <bit>
#include <cstdlib>

namespace videogrammetry::edge_pair {
namespace {

/// Sides allowed beyond those of the bounding box, for the smallest regions.
constexpr int kSlack = 6;

/// Bits first ... last.
std::uint64_t Span(int first, int last) {
  return (~std::uint64_t{0} >> (63 - last)) & (~std::uint64_t{0} << first);
}

/// Sum of squares 0 ... m; 0 for -1.
std::int64_t Squares(std::int64_t m) { return m * (m + 1) * (2 * m + 1) / 6; }

}  // namespace

RegionGrower::RegionGrower(const SampleRows& rows, int max_extent_px)
    : rows_(rows),
      max_extent_(max_extent_px),
      left_below_(static_cast<std::size_t>(max_extent_px) + 1) {}

bool RegionGrower::Grow(int x, int y, int level) {
  level_ = level;
  // The word's window has the pixel in its middle, and its ends in the picture.
  window_ = std::max(0, std::min(x - 32, rows_.width - 64)) & ~1;
  wide_ = false;
  Next end = Area(x, y);
  if (end == Next::kWider) {
    wide_ = true;
    end = Area(x, y);
  }
  return end == Next::kEnd && !IsRagged();
}

void RegionGrower::Restart(int x, int y) {
  x0_ = x;
  y0_ = y;
  n_ = sx_ = sy_ = sxx_ = sxy_ = syy_ = 0;
  sideways_ = num_below_ = 0;
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
  left_below_[static_cast<std::size_t>(num_below_++)] = start.left;
  // Downwards first: should the area be refused, the rows to come know its border.
  const Next below = Walk(1, start);
  return below == Next::kEnd ? Walk(-1, start) : below;
}

RegionGrower::Next RegionGrower::Walk(int direction, Run last) {
  for (int y = y0_ + direction;; y += direction) {
    if (y < 0 || y >= rows_.height) return Next::kFailed;  // cut by the picture's border
    Run run;
    const Next next = Row(y, direction, last, &run);
    if (next == Next::kEnd) sideways_ += last.right - last.left + 1;
    if (next != Next::kRun) return next;
    sideways_ += std::abs(run.left - last.left) + std::abs(run.right - last.right);
    Add(y, run);
    if (right_ - left_ >= max_extent_ || bottom_ - top_ >= max_extent_) return Next::kFailed;
    if (direction > 0) left_below_[static_cast<std::size_t>(num_below_++)] = run.left;
    last = run;
  }
}

RegionGrower::Next RegionGrower::Row(int y, int direction, const Run& last, Run* run) {
  const Next next = wide_ ? WideRow(y, last, run) : NarrowRow(y, direction, last, run);
  const bool cut = next == Next::kRun && (run->left == 0 || run->right == rows_.width - 1);
  return cut ? Next::kFailed : next;
}

RegionGrower::Next RegionGrower::NarrowRow(int y, int direction, const Run& last, Run* run) {
  if (y < block_.first || y >= block_.first + block_.count) {
    block_.first = direction > 0 ? y : std::max(0, y - kBlock + 1);
    block_.count = direction > 0 ? std::min(kBlock, rows_.height - y) : y - block_.first + 1;
    rows_.Mask(window_, block_.first, block_.count, level_, block_.masks.data());
  }
  const std::uint64_t mask = block_.masks[static_cast<std::size_t>(y - block_.first)];
  const std::uint64_t touching = mask & Span(last.left - window_, last.right - window_);
  if (touching == 0) return Next::kEnd;
  const int first = std::countr_zero(touching), final = 63 - std::countl_zero(touching);
  // The nearest clear bits beyond.
  const std::uint64_t below = ~mask & ~(~std::uint64_t{0} << first);
  const std::uint64_t above = ~mask & (~std::uint64_t{0} << final) & ~(std::uint64_t{1} << final);
  const int left = 64 - std::countl_zero(below), right = std::countr_zero(above) - 1;
  *run = {window_ + left, window_ + right};
  // At the window's end, but not the picture's, there may be more.
  const bool more = (left == 0 && window_ > 0) || (right == 63 && run->right + 1 < rows_.width);
  return more ? Next::kWider : Next::kRun;
}

std::uint64_t RegionGrower::Word(int y, int x) const {
  std::uint64_t word;
  rows_.Mask(x, y, 1, level_, &word);
  return word;
}

RegionGrower::Next RegionGrower::WideRow(int y, const Run& last, Run* run) const {
  // Words begin at multiples of 64. The row's ends are looked for from both sides.
  const auto base = [](int x) { return x & ~63; };
  int first = -1, final = -1;
  for (int x = base(last.left); x <= last.right && first < 0; x += 64) {
    const std::uint64_t in = Span(std::max(0, last.left - x), std::min(63, last.right - x));
    const std::uint64_t hit = Word(y, x) & in;
    if (hit != 0) first = x + std::countr_zero(hit);
  }
  if (first < 0) return Next::kEnd;
  for (int x = base(last.right); final < 0; x -= 64) {
    const std::uint64_t in = Span(std::max(0, last.left - x), std::min(63, last.right - x));
    const std::uint64_t hit = Word(y, x) & in;
    if (hit != 0) final = x + 63 - std::countl_zero(hit);
  }
  *run = {0, rows_.width - 1};
  const int least = std::max(0, first - max_extent_), most = final + max_extent_;
  for (int x = base(first); x >= 0 && x + 63 >= least; x -= 64) {
    const std::uint64_t clear = ~Word(y, x) & Span(0, std::min(63, first - x));
    if (clear != 0) {
      run->left = x + 64 - std::countl_zero(clear);
      break;
    }
  }
  for (int x = base(final); x < rows_.width && x <= most; x += 64) {
    const std::uint64_t clear = ~Word(y, x) & Span(std::max(0, final - x), 63);
    if (clear != 0) {
      run->right = std::min(rows_.width, x + std::countr_zero(clear)) - 1;
      break;
    }
  }
  return Next::kRun;
}

void RegionGrower::Add(int y, const Run& run) {
  left_ = std::min(left_, run.left);
  right_ = std::max(right_, run.right);
  top_ = std::min(top_, y);
  bottom_ = std::max(bottom_, y);
  const std::int64_t a = run.left - x0_, b = run.right - x0_, v = y - y0_, n = b - a + 1;
  const std::int64_t sum = n * (a + b) / 2;
  n_ += n;
  sx_ += sum;
  sy_ += n * v;
  sxx_ += Squares(b) - Squares(a - 1);
  sxy_ += sum * v;
  syy_ += n * v * v;
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
  const double mx = static_cast<double>(sx_) / n, my = static_cast<double>(sy_) / n;
  m.area = n;
  m.mean_x = x0_ + mx;
  m.mean_y = y0_ + my;
  m.var_xx = static_cast<double>(sxx_) / n - mx * mx;
  m.var_xy = static_cast<double>(sxy_) / n - mx * my;
  m.var_yy = static_cast<double>(syy_) / n - my * my;
  return m;
}

}  // namespace videogrammetry::edge_pair
