#include "videogrammetry/recognition/edge_pair_search.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <numbers>
#include <optional>

#include "videogrammetry/recognition/edge_pair_chords.h"
#include "videogrammetry/recognition/edge_pair_samples.h"
#include "videogrammetry/recognition/edge_pair_star.h"
#include "videogrammetry/recognition/place_index.h"

namespace videogrammetry {
namespace {

using edge_pair::Pair;
using edge_pair::RowPairs;
using edge_pair::SampleRows;
using edge_pair::Samples;
using edge_pair::Star;
using edge_pair::StarLook;
using edge_pair::Storage;

/// Pixels of a rise or fall that are looked at, from its inner end.
constexpr int kLongestEdge = 64;
/// Scanned rows that are fetched from memory before they are looked at.
constexpr int kRowsAhead = 4;
/// Least minor over major axis: a tilt of 80 degrees.
constexpr double kLeastRatio = 0.18;
/// Length of a chord, in steps from row to row, from which on there must be chords of half
/// of it in the rows on both sides: 20 steps suffice on an ellipse of the least ratio, whose
/// half height is 0.09 of the chord through its centre or more, as those lie 1.5 steps from
/// there at most and a half height of 1.73 steps has them. Some are broken: 30.
constexpr int kLongInRows = 30;
/// Chords that are gathered before they are looked at, how many of them ahead the samples
/// around one are fetched, and how far up and down.
constexpr std::size_t kChordsAtOnce = 32, kChordsAhead = 4;
constexpr int kReachPx = 12;
/// The middle of an area, in its radii.
constexpr double kMiddle = 0.7;
/// Freedom of the axes, pixels: they are judged after the fit.
constexpr double kFreePx = 1.0;

/// What is kept of a row until the rows beside it have been scanned.
struct ScannedRow {
  explicit ScannedRow(int width)
      : up(static_cast<std::size_t>(width + 61) / 64), down(up.size()), pairs(width) {}
  std::vector<std::uint64_t> up, down;
  RowPairs pairs;
};

/// Grey values along a chord.
struct Chord {
  int middle = 0, y = 0;  ///< a pixel of the area
  int length = 0;
  int inside = 0, outside = 0;
  int level() const { return outside + (inside - outside + 1) / 2; }
};

template <Storage kStorage>
class EdgePairSearch {
 public:
  EdgePairSearch(const SampleRows& rows, const EdgeThreshold& threshold,
                 const std::array<double, 2>& diameter_px, const KnownParts* known)
      : rows_(rows),
        known_(known != nullptr && !known->empty() ? known : nullptr),
        samples_(rows),
        threshold_(threshold),
        min_diameter_(diameter_px[0]),
        max_diameter_(diameter_px[1]),
        max_length_(static_cast<int>(max_diameter_ + 1)),
        row_step_(std::max(1, static_cast<int>(min_diameter_ / 2.0))),
        least_length_(static_cast<int>(std::ceil(0.6 * min_diameter_))),
        star_(samples_, max_length_, min_diameter_ - kFreePx - 0.5),
        which_(static_cast<std::size_t>(rows.width + 61) / 64 + 1),
        taken_(static_cast<std::size_t>(rows.width / 2 + 1)),
        scanned_{ScannedRow(rows.width), ScannedRow(rows.width), ScannedRow(rows.width)},
        index_(rows.width, rows.height) {
    chords_.reserve(2 * kChordsAtOnce);
  }

  /// The window lies in the picture, is 3 pixels wide or more and begins in an even column.
  void Search(const SearchWindow& window) {
    ++window_;
    left_ = window.left;
    width_ = window.right - window.left + 1;
    const std::uint8_t* first = rows_.row(0) + samples_.BytesTo(left_);
    // The whole picture's rows.
    int row = std::max(0, window.top - row_step_ / 2 + row_step_ - 1) / row_step_;
    const int first_row = row;
    for (ScannedRow& scanned : scanned_) scanned.pairs.Clear();
    for (int y = RowAt(row); y <= window.bottom; y = RowAt(++row)) {
      ScannedRow& now = Scanned(row);
      Prefetch(first + RowAt(row + kRowsAhead) * rows_.stride_bytes, RowAt(row + kRowsAhead));
      const int found = FindEdges(first + y * rows_.stride_bytes, &now);
      now.pairs.Find(Rises(now), Falls(now), which_.data(), found, max_length_);
      if (row > first_row) TakeLongest(row - 1);
    }
    Scanned(row).pairs.Clear();
    if (row > first_row) TakeLongest(row - 1);
    LookAtChords();
  }

  std::vector<DotRegion> Take() { return std::move(regions_); }

 private:
  int RowAt(int row) const { return row_step_ / 2 + row * row_step_; }

  // Rows lie further apart than the processor looks ahead by itself.
  void Prefetch([[maybe_unused]] const std::uint8_t* row, int y) const {
    if (y >= rows_.height) return;
#if defined(__GNUC__)
    const std::ptrdiff_t bytes = samples_.BytesTo(width_ & ~1);
    for (std::ptrdiff_t at = 0; at < bytes; at += 64) __builtin_prefetch(row + at);
#endif
  }

  // @return how many words of the row have any.
  int FindEdges(const std::uint8_t* row, ScannedRow* scanned) {
    const edge_pair::Kernels& kernels = *rows_.kernels;
    const EdgeThreshold& t = threshold_;
    std::uint64_t *up = scanned->up.data(), *down = scanned->down.data();
    const int found = kernels.edges(row, width_, t.least, up, down, which_.data());
    if (!t.Grows()) return found;
    return kernels.brighter(row, width_, t.least, {t.from_grey, t.per_grey, t.most}, up, down,
                            which_.data(), found);
  }

  ScannedRow& Scanned(int row) { return scanned_[static_cast<std::size_t>(row + 3) % 3]; }
  // In negated values rises and falls change places.
  const std::uint64_t* Rises(const ScannedRow& row) const {
    return rows_.flip == 0 ? row.up.data() : row.down.data();
  }
  const std::uint64_t* Falls(const ScannedRow& row) const {
    return rows_.flip == 0 ? row.down.data() : row.up.data();
  }

  // Takes the pairs that are longer than those of the same area in the rows beside: an
  // ellipse's chords grow up to the one next to its centre, and then shrink. Long ones have
  // some on both sides, of an area that is high enough. (Short ones alone are of dots that
  // shine or are in shadow as often as of noise.)
  void TakeLongest(int row) {
    y_ = RowAt(row);
    const ScannedRow& now = Scanned(row);
    const ScannedRow &above = Scanned(row + 2), &below = Scanned(row + 1);  // row - 1, row + 1
    const int count =
        rows_.kernels->longest(now.pairs.list(), above.pairs.list(), below.pairs.list(),
                               kLongInRows * row_step_, taken_.data());
    for (int i = 0; i < count; ++i) TakeChord(now.pairs[taken_[static_cast<std::size_t>(i)]], now);
    if (chords_.size() >= kChordsAtOnce) LookAtChords();
  }

  // What lies between the scanned rows is not yet near the processor: it is fetched some
  // chords before it is looked at.
  void LookAtChords() {
    for (std::size_t i = 0; i < chords_.size(); ++i) {
      if (i + kChordsAhead < chords_.size()) PrefetchAround(chords_[i + kChordsAhead]);
      LookAt(&chords_[i]);
    }
    chords_.clear();
  }

  void PrefetchAround([[maybe_unused]] const Chord& chord) const {
#if defined(__GNUC__)
    const int reach = std::min(chord.length, kReachPx);
    const int last = std::min(rows_.height - 1, chord.y + reach);
    for (int y = std::max(0, chord.y - reach); y <= last; ++y) {
      __builtin_prefetch(rows_.row(y) + samples_.BytesTo(chord.middle & ~1));
    }
#endif
  }

  // First bit of the run that ends with `bit`, and last of the one that begins with it.
  static int RunStart(const std::uint64_t* words, int bit) {
    int length = std::countl_one(words[bit / 64] << (63 - bit % 64));
    if (length == bit % 64 + 1 && bit >= 64) length += std::countl_one(words[bit / 64 - 1]);
    return bit - std::min(length, kLongestEdge) + 1;
  }
  int RunEnd(const std::uint64_t* words, int bit) const {
    int length = std::countr_one(words[bit / 64] >> (bit % 64));
    if (length == 64 - bit % 64 && bit / 64 + 1 < (width_ + 61) / 64) {
      length += std::countr_one(words[bit / 64 + 1]);
    }
    return bit + std::min(length, kLongestEdge) - 1;
  }

  void TakeChord(const Pair& pair, const ScannedRow& scanned) {
    if (known_ != nullptr && known_->Holds(Middle(pair), y_)) return;
    // Bit i belongs to the window's pixel i + 1.
    const int rise = RunStart(Rises(scanned), pair.rise) + 1 + left_;
    const int fall = RunEnd(Falls(scanned), pair.fall) + 1 + left_;
    if (fall - rise < least_length_) return;
    if (const auto chord = MeasureChord(pair, rise, fall)) chords_.push_back(*chord);
  }

  void LookAt(Chord* chord) {
    if (IsOfKnown(*chord)) return;
    auto star = star_.Look(chord->middle, chord->y, chord->level(), chord->length);
    if (star && BrightenLikeMiddle(*star, chord)) {
      const auto brighter = star_.Look(RoundedX(*star), RoundedY(*star), chord->level(), 1 << 16);
      if (brighter) star = brighter;
    }
    if (star) Accept(*star, *chord);
  }

  // Whether the chord lies across the middle of an area that was found in this window at
  // much the same level: another of its rows. (Not in another window: that may hold a part
  // of the area alone.)
  bool IsOfKnown(const Chord& chord) const {
    const double half = 0.5 * chord.length;
    return index_.AnyNear(chord.middle, chord.y, half, [&](int number) {
      const Found& found = found_[static_cast<std::size_t>(number)];
      if (found.window != window_) return false;
      const int difference = std::abs(found.level - chord.level());
      if (8 * difference > chord.inside - chord.outside) return false;
      const double dx = chord.middle - found.star.x, dy = chord.y - found.star.y;
      const Star& s = found.star;
      return s.sxx * dx * dx + 2.0 * s.sxy * dx * dy + s.syy * dy * dy < kMiddle * kMiddle;
    });
  }

  int Middle(const Pair& pair) const { return (pair.rise + pair.fall) / 2 + 1 + left_; }
  static int RoundedX(const Star& star) { return static_cast<int>(star.x + 0.5f); }
  static int RoundedY(const Star& star) { return static_cast<int>(star.y + 0.5f); }

  // A chord near the area's border is darker than the middle: its level is too low and its
  // area too large. True if the middle is so much brighter that this matters.
  bool BrightenLikeMiddle(const Star& star, Chord* chord) const {
    const int x = RoundedX(star), y = RoundedY(star);
    if (x < 1 || x + 1 >= rows_.width || y < 0 || y >= rows_.height) return false;
    const int inside = (samples_(x - 1, y) + samples_(x, y) + samples_(x + 1, y)) / 3;
    const bool brighter = 8 * (inside - chord->inside) > chord->inside - chord->outside;
    if (brighter) chord->inside = inside;
    return brighter;
  }

  // Values at the chord's middle and where its edges begin and end. Much the same ground on
  // both sides, the smaller contrast at least half the larger: not so in texture.
  std::optional<Chord> MeasureChord(const Pair& pair, int rise, int fall) const {
    Chord chord;
    chord.y = y_;
    chord.middle = Middle(pair);
    chord.length = (pair.length() + fall - rise) / 2;
    if (chord.middle < 1 || chord.middle + 1 >= rows_.width) return std::nullopt;
    const int a = samples_(chord.middle - 1, y_), b = samples_(chord.middle, y_),
              c = samples_(chord.middle + 1, y_);
    chord.inside = (a + b + c) / 3;
    const int left = samples_(std::max(0, rise - 1), y_);
    const int right = samples_(std::min(rows_.width - 1, fall + 1), y_);
    chord.outside = std::max(left, right);
    const int least = chord.inside - chord.outside, most = chord.inside - std::min(left, right);
    const int brighter = std::max(chord.inside ^ rows_.flip, chord.outside ^ rows_.flip);
    if (least < threshold_.At(brighter) || 2 * least < most || b < chord.level())
      return std::nullopt;
    return chord;
  }

  void Accept(const Star& star, const Chord& chord) {
    // Semi axes: 1 / sqrt of the eigenvalues of S.
    const double mean = 0.5 * (star.sxx + star.syy);
    const double half = std::hypot(0.5 * (star.sxx - star.syy), double{star.sxy});
    if (!(mean - half > 0.0)) return;
    const double major = 1.0 / std::sqrt(mean - half), minor = 1.0 / std::sqrt(mean + half);
    if (minor < kLeastRatio * major || 2.0 * minor < min_diameter_ - kFreePx ||
        2.0 * major > max_diameter_ + kFreePx) {
      return;
    }
    DotRegion region;
    ContourMoments& m = region.moments;
    const double det = double{star.sxx} * star.syy - double{star.sxy} * star.sxy;
    m.mean_x = star.x;
    m.mean_y = star.y;
    m.area = std::numbers::pi * major * minor;
    // The second moments of an ellipse's inside: S^-1 / 4.
    m.var_xx = 0.25 * star.syy / det;
    m.var_xy = -0.25 * star.sxy / det;
    m.var_yy = 0.25 * star.sxx / det;
    m.width_px = static_cast<int>(std::ceil(4.0 * std::sqrt(m.var_xx)));
    m.height_px = static_cast<int>(std::ceil(4.0 * std::sqrt(m.var_yy)));
    index_.Insert(star.x, star.y, static_cast<int>(found_.size()));
    found_.push_back({star, chord.level(), window_});
    const auto zero = static_cast<float>(rows_.flip);
    region.inside = static_cast<float>(chord.inside) - zero;
    region.outside = static_cast<float>(chord.outside) - zero;
    regions_.push_back(region);
  }

  const SampleRows& rows_;
  const KnownParts* const known_;
  const Samples<kStorage> samples_;
  const EdgeThreshold threshold_;
  const double min_diameter_, max_diameter_;
  const int max_length_;  ///< of a chord, from edge to edge
  const int row_step_;
  const int least_length_;  ///< of a chord
  const StarLook<kStorage> star_;
  int left_ = 0, width_ = 0;  ///< of the window
  int y_ = 0;
  std::vector<int> which_;     ///< words of the row with edges
  std::vector<int> taken_;     ///< pairs of the row
  std::vector<Chord> chords_;  ///< not yet looked at
  std::array<ScannedRow, 3> scanned_;
  /// What an area was found as.
  struct Found {
    Star star;
    int level;
    int window;
  };

  int window_ = -1;  ///< number of the window
  std::vector<Found> found_;
  PlaceIndex index_;
  std::vector<DotRegion> regions_;
};

}  // namespace

void KnownParts::Add(const Ellipse& e, double radii) {
  const double c = std::cos(e.angle_rad), s = std::sin(e.angle_rad);
  const double a = 1.0 / std::pow(radii * e.semi_major_px, 2),
               b = 1.0 / std::pow(radii * e.semi_minor_px, 2);
  index_.Insert(e.x_px, e.y_px, static_cast<int>(parts_.size()));
  parts_.push_back({e.x_px, e.y_px, a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c});
  reach_px_ = std::max(reach_px_, radii * e.semi_major_px);
}

bool KnownParts::Holds(double x_px, double y_px) const {
  return index_.AnyNear(x_px, y_px, reach_px_, [&](int number) {
    const Part& p = parts_[static_cast<std::size_t>(number)];
    const double x = x_px - p.x, y = y_px - p.y;
    return p.sxx * x * x + 2.0 * p.sxy * x * y + p.syy * y * y < 1.0;
  });
}

std::vector<DotRegion> FindDotRegions(const FrameView& frame, int sign,
                                      const std::array<double, 2>& diameter_px,
                                      EdgeThreshold threshold,
                                      const std::vector<SearchWindow>& windows,
                                      const KnownParts* known, InstructionSet set) {
  const SampleRows rows(frame, sign, set);
  const auto search = [&](auto&& in_storage) {
    for (SearchWindow window : windows) {
      // Packed samples begin with an even one.
      window.left = std::max(0, window.left) & ~1;
      window.top = std::max(0, window.top);
      window.right = std::min(rows.width - 1, window.right);
      window.bottom = std::min(rows.height - 1, window.bottom);
      if (window.right - window.left >= 2) in_storage.Search(window);
    }
    return in_storage.Take();
  };
  switch (rows.storage) {
    case edge_pair::kBytes:
      return search(EdgePairSearch<edge_pair::kBytes>(rows, threshold, diameter_px, known));
    case edge_pair::kWords:
      return search(EdgePairSearch<edge_pair::kWords>(rows, threshold, diameter_px, known));
    case edge_pair::kPackedHighFirst:
      return search(
          EdgePairSearch<edge_pair::kPackedHighFirst>(rows, threshold, diameter_px, known));
    default:
      return search(
          EdgePairSearch<edge_pair::kPackedLowFirst>(rows, threshold, diameter_px, known));
  }
}

std::vector<DotRegion> FindDotRegions(const FrameView& frame, int sign,
                                      const std::array<double, 2>& diameter_px,
                                      EdgeThreshold threshold, InstructionSet set) {
  const int width = FrameWidth(frame), height = FrameHeight(frame);
  if (width < 3 || height < 3) return {};
  const std::vector<SearchWindow> whole = {{0, 0, width - 1, height - 1}};
  return FindDotRegions(frame, sign, diameter_px, threshold, whole, nullptr, set);
}

std::vector<DotRegion> FindDotRegions(const FrameView& frame, int sign,
                                      const std::array<double, 2>& diameter_px,
                                      InstructionSet set) {
  if (FrameWidth(frame) < 3 || FrameHeight(frame) < 3) return {};
  const int threshold = GradientThreshold(SampleGreyStatistics(frame, set));
  return FindDotRegions(frame, sign, diameter_px, threshold, set);
}

}  // namespace videogrammetry
