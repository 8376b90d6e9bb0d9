#include "videogrammetry/recognition/candidate_search.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstdlib>

#include "videogrammetry/recognition/contour.h"
#include "videogrammetry/recognition/gradient_mask.h"

namespace videogrammetry {
namespace {

/// A chord's smaller contrast to one side over that to the other.
constexpr double kLeastBalance = 0.5;
/// Mean deviation of the grey values in a chord's middle half over its contrast.
constexpr double kMostUneven = 0.15;

/// A run of pixels in a row whose gradient exceeds the threshold with one sign.
struct EdgeRun {
  int first = 0;
  int last = -2;
  bool rise = false;
};

/// Grey values along a chord and the level at which its area is cut out.
struct Chord {
  int left = 0;  ///< first pixel of the area at this level
  int level = 0;
  int inside = 0;
};

template <typename T>
class CandidateSearch {
 public:
  CandidateSearch(const SignedImage<T>& image, const RecognitionOptions& options, int threshold)
      : image_(image),
        threshold_(threshold),
        min_diameter_(options.diameter_px[0]),
        max_diameter_(options.diameter_px[1]),
        // A circle of the smallest diameter d is then cut within d/4 of its
        // centre: by a chord of at least 0.87 d.
        row_step_(std::max(1, static_cast<int>(min_diameter_ / 2.0))),
        mask_(SelectGradientMask<T>(DetectInstructionSet())),
        visits_((static_cast<std::size_t>(image.height() / row_step_) + 1) *
                static_cast<std::size_t>(image.width())),
        contour_(image, static_cast<int>(max_diameter_) + 2) {}

  std::vector<Candidate> Run() {
    const std::size_t words = static_cast<std::size_t>(image_.width() + 63) / 64;
    std::vector<std::uint64_t> up(words), down(words);
    // For dark dots the picture is negated: rises and falls change places.
    std::uint64_t* rises = image_.sign() > 0 ? up.data() : down.data();
    std::uint64_t* falls = image_.sign() > 0 ? down.data() : up.data();
    for (int y = row_step_ / 2; y < image_.height(); y += row_step_) {
      mask_(image_.row(y), image_.width(), threshold_, up.data(), down.data());
      ScanRow(y, static_cast<int>(words), rises, falls);
    }
    return std::move(candidates_);
  }

 private:
  static constexpr std::uint8_t kAccepted = 255;
  static constexpr std::uint8_t kMaxVisits = 2;

  std::uint8_t& Visits(int x, int y) {
    return visits_[static_cast<std::size_t>(y / row_step_) *
                       static_cast<std::size_t>(image_.width()) +
                   static_cast<std::size_t>(x)];
  }
  bool IsScanned(int y) const { return y % row_step_ == row_step_ / 2; }

  void ScanRow(int y, int words, const std::uint64_t* rises, const std::uint64_t* falls) {
    EdgeRun previous, current;
    for (int i = 0; i < words; ++i) {
      std::uint64_t bits = rises[i] | falls[i];
      while (bits != 0) {
        const int bit = std::countr_zero(bits);
        bits &= bits - 1;
        const int x = 64 * i + bit;
        const bool rise = (rises[i] >> bit) & 1;
        if (x == current.last + 1 && rise == current.rise) {
          current.last = x;
          continue;
        }
        EndRun(y, previous, current);
        previous = current;
        current = {x, x, rise};
      }
    }
    EndRun(y, previous, current);
  }

  // A fall that follows a rise closes a chord.
  void EndRun(int y, const EdgeRun& rise, const EdgeRun& fall) {
    if (fall.last < 0 || rise.last < 0 || fall.rise || !rise.rise) return;
    const int longest = fall.last - rise.first;
    const int shortest = fall.first - rise.last;
    if (longest < 0.6 * min_diameter_ || shortest > max_diameter_ + 1) return;
    if (const auto chord = MeasureChord(y, rise, fall)) Follow(y, *chord);
  }

  int Steepest(int y, const EdgeRun& run) const {
    const int direction = run.rise ? 1 : -1;
    int best = run.first, best_gradient = 0;
    for (int x = run.first; x <= run.last; ++x) {
      const int g = direction * (image_(x + 1, y) - image_(x - 1, y));
      if (g > best_gradient) {
        best_gradient = g;
        best = x;
      }
    }
    return best;
  }

  // Smallest value within three pixels of the edge and as far as it goes on falling.
  int Outside(int y, int edge, int step) const {
    int lowest = image_(edge, y);
    int x = edge + step;
    for (int i = 0; i < 8 && x >= 0 && x < image_.width(); ++i, x += step) {
      const int value = image_(x, y);
      if (value >= lowest && i >= 3) break;
      lowest = std::min(lowest, value);
    }
    return lowest;
  }

  std::optional<Chord> MeasureChord(int y, const EdgeRun& rise, const EdgeRun& fall) const {
    const int left = Steepest(y, rise), right = Steepest(y, fall);
    if (right - left < 0.6 * min_diameter_ || right - left > max_diameter_ + 1) return std::nullopt;
    const int margin = (right - left) / 4;
    std::int64_t sum = 0;
    for (int x = left + margin; x <= right - margin; ++x) sum += image_(x, y);
    const int count = right - left - 2 * margin + 1;
    const int inside = static_cast<int>(sum / count);
    std::int64_t deviation = 0;
    for (int x = left + margin; x <= right - margin; ++x) {
      deviation += std::abs(image_(x, y) - inside);
    }
    const int left_outside = Outside(y, left, -1), right_outside = Outside(y, right, 1);
    const int outside = std::max(left_outside, right_outside);
    const int contrast = inside - std::min(left_outside, right_outside);
    // Even inside, and much the same ground on both sides: not so in texture.
    if (inside - outside < std::max<double>(threshold_, kLeastBalance * contrast) ||
        static_cast<double>(deviation) > kMostUneven * contrast * count) {
      return std::nullopt;
    }
    Chord chord;
    chord.inside = inside;
    chord.level = outside + (inside - outside + 1) / 2;
    int x = (left + right) / 2;
    if (image_(x, y) < chord.level) return std::nullopt;
    while (x > 0 && image_(x - 1, y) >= chord.level) --x;
    if (x == 0) return std::nullopt;  // cut by the picture's border
    chord.left = x;
    return chord;
  }

  bool SeenEnough(int x, int y) {
    for (int i = std::max(0, x - 1); i <= std::min(image_.width() - 1, x + 1); ++i) {
      if (Visits(i, y) >= kMaxVisits) return true;
    }
    return false;
  }

  void Follow(int y, const Chord& chord) {
    if (SeenEnough(chord.left, y)) return;
    const ContourEnd end = contour_.Follow(chord.left, y, chord.level);
    const auto ellipse = end == ContourEnd::kClosed ? Accept(contour_.Moments()) : std::nullopt;
    contour_.ForEachLeftSide([&](const LeftSide& side) {
      if (!IsScanned(side.y)) return;
      std::uint8_t& visits = Visits(side.x, side.y);
      if (ellipse) {
        visits = kAccepted;
      } else if (visits < kMaxVisits) {
        ++visits;
      }
    });
    if (!ellipse) return;
    candidates_.push_back(
        {*ellipse, static_cast<float>(chord.inside), static_cast<float>(chord.level)});
  }

  std::optional<Ellipse> Accept(const ContourMoments& m) const {
    if (std::min(m.width_px, m.height_px) < 0.6 * min_diameter_) return std::nullopt;
    if (!IsLikeEllipse(m)) return std::nullopt;
    const auto ellipse = EllipseFromMoments(m);
    if (!ellipse || ellipse->semi_minor_px < 0.2 * ellipse->semi_major_px) return std::nullopt;
    // Half a pixel of freedom: the axes are judged after the fit.
    if (2 * ellipse->semi_minor_px < min_diameter_ - 1.0) return std::nullopt;
    if (2 * ellipse->semi_major_px > max_diameter_ + 1.0) return std::nullopt;
    return ellipse;
  }

  const SignedImage<T>& image_;
  const int threshold_;
  const double min_diameter_, max_diameter_;
  const int row_step_;
  const GradientMaskRow<T> mask_;
  std::vector<std::uint8_t> visits_;
  ContourFollower<T> contour_;
  std::vector<Candidate> candidates_;
};

}  // namespace

template <typename T>
std::vector<Candidate> FindCandidates(const SignedImage<T>& image,
                                      const RecognitionOptions& options, int gradient_threshold) {
  if (image.width() < 3 || image.height() < 3) return {};
  return CandidateSearch<T>(image, options, gradient_threshold).Run();
}

template std::vector<Candidate> FindCandidates(const SignedImage<std::uint8_t>&,
                                               const RecognitionOptions&, int);
template std::vector<Candidate> FindCandidates(const SignedImage<std::uint16_t>&,
                                               const RecognitionOptions&, int);

}  // namespace videogrammetry
