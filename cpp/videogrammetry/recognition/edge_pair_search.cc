#include "videogrammetry/recognition/edge_pair_search.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <optional>

#include "videogrammetry/recognition/edge_pair_region.h"
#include "videogrammetry/recognition/edge_pair_samples.h"
#include "videogrammetry/recognition/edge_pair_visits.h"
#include "videogrammetry/recognition/gradient_threshold.h"

namespace videogrammetry {
namespace {

using edge_pair::BorderVisits;
using edge_pair::RegionGrower;
using edge_pair::Run;
using edge_pair::SampleRows;

/// Mean deviation of the grey values in a chord's middle half over its contrast, in percent.
constexpr std::int64_t kMostUnevenPercent = 15;
/// Pixels of a rise or fall that are looked at, from its inner end.
constexpr int kLongestEdge = 64;
/// Pixels beyond a chord's edges that are looked at for the surroundings, and one for
/// the gradient.
constexpr int kSurroundings = 9;

/// Pixels by which an area may end further on one side of its middle than on the other,
/// and an eighth of its extent.
constexpr int kMostUnlike = 2;

/// Columns that share the memory of the last area found in them.
constexpr std::size_t kColumns = 8;

/// Grey values along a chord.
struct Chord {
  int middle = 0;  ///< a pixel of the area
  int length = 0;
  int inside = 0, outside = 0;
  int level() const { return outside + (inside - outside + 1) / 2; }
};

class EdgePairSearch {
 public:
  EdgePairSearch(const SampleRows& rows, int threshold, const std::array<double, 2>& diameter_px)
      : rows_(rows),
        threshold_(threshold),
        min_diameter_(diameter_px[0]),
        max_diameter_(diameter_px[1]),
        max_length_(static_cast<int>(max_diameter_ + 1)),
        row_step_(std::max(1, static_cast<int>(min_diameter_ / 2.0))),
        least_length_(static_cast<int>(std::ceil(0.6 * min_diameter_))),
        visits_(rows.width, (max_length_ + 1) / row_step_ + 2),
        grower_(rows, max_length_ + 1),
        line_(static_cast<std::size_t>(max_length_ + 2 * (kLongestEdge + kSurroundings + 2) +
                                       edge_pair::kSampleSlack)),
        latest_(static_cast<std::size_t>(rows.width) / kColumns + 1, -1) {}

  std::vector<DotRegion> Search() {
    const auto words = static_cast<std::size_t>(rows_.width + 61) / 64;
    for (ScannedRow& row : scanned_) {
      row.up.resize(words);
      row.down.resize(words);
    }
    std::vector<int> which(words + 1);
    int y = row_step_ / 2;
    for (int row = 0; y < rows_.height; y += row_step_, ++row) {
      ScannedRow& now = Scanned(row);
      const int found = rows_.kernels->edges(rows_.row(y), rows_.width, threshold_, now.up.data(),
                                             now.down.data(), which.data());
      now.pairs.clear();
      FindPairs(which.data(), found, &now);
      FollowLongest(row - 1);
    }
    const int rows = (y - row_step_ / 2) / row_step_;
    Scanned(rows).pairs.clear();
    FollowLongest(rows - 1);
    return std::move(regions_);
  }

 private:
  /// Last bit of a rise and first of the fall after it, without another edge between.
  struct Pair {
    int rise, fall;
    int length() const { return fall - rise; }
  };

  /// What is kept of a row until the rows beside it have been scanned.
  struct ScannedRow {
    std::vector<std::uint64_t> up, down;
    std::vector<Pair> pairs;
  };

  ScannedRow& Scanned(int row) { return scanned_[static_cast<std::size_t>(row + 3) % 3]; }
  // In negated values rises and falls change places.
  const std::uint64_t* Rises(const ScannedRow& row) const {
    return rows_.flip == 0 ? row.up.data() : row.down.data();
  }
  const std::uint64_t* Falls(const ScannedRow& row) const {
    return rows_.flip == 0 ? row.down.data() : row.up.data();
  }

  // Goes through the beginnings of falls; those whose nearest edge before is a rise
  // close a chord.
  void FindPairs(const int* which, int found, ScannedRow* row) const {
    const std::uint64_t* all_rises = Rises(*row);
    const std::uint64_t* all_falls = Falls(*row);
    int last_edge = -1;  // in the words before
    bool last_rises = false;
    for (int j = 0; j < found; ++j) {
      const int i = which[j], base = 64 * i;
      const std::uint64_t rises = all_rises[i], falls = all_falls[i], edges = rises | falls;
      const std::uint64_t before = i > 0 ? all_falls[i - 1] >> 63 : 0;
      std::uint64_t starts = falls & ~(falls << 1 | before);
      while (starts != 0) {
        const int bit = std::countr_zero(starts);
        starts &= starts - 1;
        const std::uint64_t below = edges & ((std::uint64_t{1} << bit) - 1);
        int edge = last_edge;
        bool is_rise = last_rises;
        if (below != 0) {
          const int at = 63 - std::countl_zero(below);
          edge = base + at;
          is_rise = (rises >> at) & 1;
        }
        if (is_rise && base + bit - edge <= max_length_) row->pairs.push_back({edge, base + bit});
      }
      const int at = 63 - std::countl_zero(edges);
      last_edge = base + at;
      last_rises = (rises >> at) & 1;
    }
  }

  // Follows the pairs that are longer than those of the same area in the rows beside: an
  // ellipse's chords grow up to the one next to its centre, and then shrink.
  void FollowLongest(int row) {
    if (row < 0) return;
    row_ = row;
    y_ = row_step_ / 2 + row * row_step_;
    const std::vector<Pair>& above = Scanned(row - 1).pairs;
    const std::vector<Pair>& below = Scanned(row + 1).pairs;
    std::size_t first_above = 0, first_below = 0;
    for (const Pair& pair : Scanned(row).pairs) {
      if (IsShorter(pair, 0, above, &first_above) || IsShorter(pair, 1, below, &first_below)) {
        continue;
      }
      ClosePair(pair);
    }
    visits_.Leave(row);
  }

  // Whether a pair of the row beside it overlaps and is longer by `least` or more. One that
  // is much longer is of another area. `first` moves along with the pairs.
  static bool IsShorter(const Pair& pair, int least, const std::vector<Pair>& beside,
                        std::size_t* first) {
    while (*first < beside.size() && beside[*first].fall <= pair.rise) ++*first;
    const int most = 2 * pair.length() + 4;
    for (std::size_t i = *first; i < beside.size() && beside[i].rise < pair.fall; ++i) {
      const int length = beside[i].length();
      if (length >= pair.length() + 1 - least && length <= most) return true;
    }
    return false;
  }

  // First bit of the run that ends with `bit`, and last of the one that begins with it.
  static int RunStart(const std::uint64_t* words, int bit) {
    int length = std::countl_one(words[bit / 64] << (63 - bit % 64));
    if (length == bit % 64 + 1 && bit >= 64) length += std::countl_one(words[bit / 64 - 1]);
    return bit - std::min(length, kLongestEdge) + 1;
  }
  int RunEnd(const std::uint64_t* words, int bit) const {
    int length = std::countr_one(words[bit / 64] >> (bit % 64));
    if (length == 64 - bit % 64 && bit / 64 + 1 < (rows_.width + 61) / 64) {
      length += std::countr_one(words[bit / 64 + 1]);
    }
    return bit + std::min(length, kLongestEdge) - 1;
  }

  void ClosePair(const Pair& pair) {
    const ScannedRow& scanned = Scanned(row_);
    // Bit i belongs to pixel i + 1.
    const Run rise{RunStart(Rises(scanned), pair.rise) + 1, pair.rise + 1};
    const Run fall{pair.fall + 1, RunEnd(Falls(scanned), pair.fall) + 1};
    if (fall.right - rise.left < least_length_) return;
    if (visits_.SeenEnough(row_, rise.left - 1, rise.right + 1)) return;
    const auto chord = MeasureChord(y_, rise, fall);
    if (chord && LooksRound(*chord)) Follow(*chord);
  }

  // Goes from a chord to the middle of the area's extent above and below, and there to
  // that of its extent to both sides: about this point an ellipse ends alike in opposite
  // directions.
  bool LooksRound(const Chord& chord) const {
    const int level = chord.level();
    // Half of five times the chord: minor / major >= 0.2.
    int most = std::min(max_length_, 5 * chord.length / 2 + 4);
    int x = chord.middle, y = y_;
    const int up = Extent(x, y, 0, -1, level, most), down = Extent(x, y, 0, 1, level, most);
    if (up > most || down > most) return false;
    y += (down - up) / 2;
    most = std::min(max_length_, 5 * (up + down + 1) / 2 + 4);
    const int left = Extent(x, y, -1, 0, level, most), right = Extent(x, y, 1, 0, level, most);
    if (left > most || right > most) return false;
    x += (right - left) / 2;
    return EndsAlike(x, y, 0, level, most) && EndsAlike(x, y, 1, level, most) &&
           EndsAlike(x, y, -1, level, most);
  }

  // Pixels at or above the level from (x, y) on, without it; most + 1 if there are more or
  // the picture ends.
  int Extent(int x, int y, int dx, int dy, int level, int most) const {
    for (int k = 1; k <= most + 1; ++k) {
      x += dx;
      y += dy;
      if (x < 0 || y < 0 || x >= rows_.width || y >= rows_.height) return most + 1;
      if (rows_.At(x, y) < level) return k - 1;
    }
    return most + 1;
  }

  bool EndsAlike(int x, int y, int dx, int level, int most) const {
    const int up = Extent(x, y, -dx, -1, level, most), down = Extent(x, y, dx, 1, level, most);
    return up <= most && down <= most && std::abs(up - down) <= kMostUnlike + (up + down) / 8;
  }

  // Values of a chord and its surroundings; x_ is the first one's pixel.
  void ReadLine(int y, int left, int right) {
    x_ = std::max(0, left - kSurroundings) & ~1;
    rows_.Read(x_, y, std::min(rows_.width, right + kSurroundings + 1) - x_, line_.data());
  }
  int Value(int x) const { return line_[static_cast<std::size_t>(x - x_)]; }

  int Steepest(const Run& run, int direction) const {
    int best = run.left, best_gradient = 0;
    for (int x = run.left; x <= run.right; ++x) {
      const int g = direction * (Value(x + 1) - Value(x - 1));
      if (g > best_gradient) {
        best_gradient = g;
        best = x;
      }
    }
    return best;
  }

  // Smallest value within three pixels of the edge and as far as it goes on falling.
  int Outside(int edge, int step) const {
    int lowest = Value(edge);
    int x = edge + step;
    for (int i = 0; i < 8 && x >= 0 && x < rows_.width; ++i, x += step) {
      const int value = Value(x);
      if (value >= lowest && i >= 3) break;
      lowest = std::min(lowest, value);
    }
    return lowest;
  }

  std::optional<Chord> MeasureChord(int y, const Run& rise, const Run& fall) {
    ReadLine(y, rise.left, fall.right);
    const int left = Steepest(rise, 1), right = Steepest(fall, -1);
    if (right - left < least_length_ || right - left > max_length_) return std::nullopt;
    const int margin = (right - left) / 4, count = right - left - 2 * margin + 1;
    // 2003 values of 16 bits at most: within 32 bits.
    const std::uint16_t* middle = line_.data() + (left + margin - x_);
    int sum = 0, deviation = 0;
    for (int i = 0; i < count; ++i) sum += middle[i];
    Chord chord;
    chord.inside = sum / count;
    for (int i = 0; i < count; ++i) deviation += std::abs(middle[i] - chord.inside);
    const int left_outside = Outside(left, -1), right_outside = Outside(right, 1);
    chord.outside = std::max(left_outside, right_outside);
    chord.middle = (left + right) / 2;
    chord.length = right - left;
    const int least_contrast = chord.inside - chord.outside;
    const int contrast = chord.inside - std::min(left_outside, right_outside);
    // Even inside, and much the same ground on both sides, the smaller contrast at least
    // half the larger: not so in texture.
    if (least_contrast < threshold_ || 2 * least_contrast < contrast ||
        100 * std::int64_t{deviation} > kMostUnevenPercent * contrast * count) {
      return std::nullopt;
    }
    return chord;
  }

  void Follow(const Chord& chord) {
    const bool closed = grower_.Grow(chord.middle, y_, chord.level(), chord.length);
    std::optional<ContourMoments> moments;
    if (closed) moments = Accepted(grower_.Moments());
    MarkBorder(moments.has_value());
    if (!moments) return;
    Chord best = chord;
    if (4 * std::abs(moments->mean_y - y_) > moments->height_px) Improve(&best, &*moments);
    if (IsKnown(*moments)) return;
    const auto zero = static_cast<float>(rows_.flip);
    regions_.push_back({*moments, static_cast<float>(best.inside) - zero,
                        static_cast<float>(best.outside) - zero});
  }

  // True for an area found before: from a row through the dot's lower border, which is too
  // dark to have its edge where the area's border was met. One area is kept for every few
  // columns, the last.
  bool IsKnown(const ContourMoments& m) {
    const auto column = static_cast<std::size_t>(m.mean_x) / kColumns;
    const std::size_t first = column > 0 ? column - 1 : 0;
    const std::size_t last = std::min(column + 1, latest_.size() - 1);
    for (std::size_t i = first; i <= last; ++i) {
      if (latest_[i] < 0) continue;
      const ContourMoments& known = regions_[static_cast<std::size_t>(latest_[i])].moments;
      // Half a pixel: what another level moves an area by.
      if (std::abs(known.mean_x - m.mean_x) < 0.5 && std::abs(known.mean_y - m.mean_y) < 0.5 &&
          std::abs(known.width_px - m.width_px) <= 2 &&
          std::abs(known.height_px - m.height_px) <= 2) {
        return true;
      }
    }
    latest_[column] = static_cast<int>(regions_.size());
    return false;
  }

  // In the rows to be scanned yet.
  void MarkBorder(bool accepted) {
    const int last = std::min(grower_.bottom(), y_ + max_length_);
    for (int y = y_, row = row_; y <= last; y += row_step_, ++row) {
      if (y >= grower_.top()) visits_.Mark(row, grower_.left_end(y), accepted);
    }
  }

  // A chord near the area's border is darker than the middle: its level is too low and its
  // area too large. Measures the chord through the middle and cuts the area out anew.
  void Improve(Chord* chord, ContourMoments* moments) {
    const int x = static_cast<int>(moments->mean_x + 0.5);
    const int y = static_cast<int>(moments->mean_y + 0.5);
    ReadLine(y, grower_.left(), grower_.right());
    if (Value(x) < chord->level()) return;
    int left = x, right = x;
    while (left > grower_.left() && Value(left - 1) >= chord->level()) --left;
    while (right < grower_.right() && Value(right + 1) >= chord->level()) ++right;
    // The area ends within a pixel of its steepest gradients; it stays off the border.
    const Run rise{std::max(1, left - 1), left + 1};
    const Run fall{right - 1, std::min(rows_.width - 2, right + 1)};
    const auto middle = MeasureChord(y, rise, fall);
    if (!middle || middle->level() == chord->level()) return;
    if (!grower_.Grow(middle->middle, y, middle->level(), 1)) return;
    const auto better = Accepted(grower_.Moments());
    if (!better) return;
    MarkBorder(true);
    *chord = *middle;
    *moments = *better;
  }

  std::optional<ContourMoments> Accepted(const ContourMoments& m) const {
    if (std::min(m.width_px, m.height_px) < least_length_) return std::nullopt;
    // 1 for an ellipse, 0.955 for a square; the pixels' share falls with the area.
    if (EllipseLikeness(m) < 0.985 - 0.8 / m.area) return std::nullopt;
    const auto ellipse = EllipseFromMoments(m);
    if (!ellipse || ellipse->semi_minor_px < 0.2 * ellipse->semi_major_px) return std::nullopt;
    // Half a pixel of freedom: the axes are judged after the fit.
    if (2 * ellipse->semi_minor_px < min_diameter_ - 1.0) return std::nullopt;
    if (2 * ellipse->semi_major_px > max_diameter_ + 1.0) return std::nullopt;
    return m;
  }

  const SampleRows rows_;
  const int threshold_;
  const double min_diameter_, max_diameter_;
  const int max_length_;  ///< of a chord, from edge to edge
  const int row_step_;
  const int least_length_;  ///< of a chord
  std::array<ScannedRow, 3> scanned_;
  int x_ = 0, y_ = 0;
  int row_ = 0;  ///< index of y_ among the scanned rows
  BorderVisits visits_;
  RegionGrower grower_;
  std::vector<std::uint16_t> line_;
  std::vector<int> latest_;  ///< index of the last area centred in the columns, or -1
  std::vector<DotRegion> regions_;
};

}  // namespace

std::vector<DotRegion> FindDotRegions(const FrameView& frame, int sign,
                                      const std::array<double, 2>& diameter_px,
                                      int gradient_threshold, InstructionSet set) {
  const SampleRows rows(frame, sign, set);
  if (rows.width < 3 || rows.height < 3) return {};
  return EdgePairSearch(rows, gradient_threshold, diameter_px).Search();
}

std::vector<DotRegion> FindDotRegions(const FrameView& frame, int sign,
                                      const std::array<double, 2>& diameter_px,
                                      InstructionSet set) {
  if (FrameWidth(frame) < 3 || FrameHeight(frame) < 3) return {};
  const int threshold = GradientThreshold(SampleGreyStatistics(frame, set));
  return FindDotRegions(frame, sign, diameter_px, threshold, set);
}

}  // namespace videogrammetry
