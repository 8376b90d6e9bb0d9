#include "videogrammetry/recognition/tracked_recognition.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <stdexcept>
#include <vector>

#include "synthetic_picture.h"

namespace videogrammetry {
namespace {

using testing::Drawn;
using testing::Picture;
using testing::Render;

RecognitionOptions FastOptions() {
  RecognitionOptions options;
  options.method = kEdgePair;
  options.estimator = Estimator::kModel;
  return options;
}

CodeFamily Family() { return NamedCodeFamily("schneider-14"); }

struct Change {
  int hidden = -1;        ///< a dot that is not there
  double turn_rad = 0.0;  ///< of the rings
  double light = 1.0;
  bool streaks = false;  ///< close beside the dots of the second row
};

/// Twelve dots, every third with a ring, that move on circles.
Picture<std::uint16_t> Moving(int frame, const Change& change = {}) {
  std::vector<Drawn> dots;
  for (int i = 0; i < 12; ++i) {
    if (i == change.hidden) continue;
    const double t = 0.15 * frame + i;
    Drawn dot{{70.0 + 90.0 * (i % 4) + 8.0 * std::cos(t), 60.0 + 90.0 * (i / 4) + 8.0 * std::sin(t),
               6.0 + 0.3 * i, 5.0 + 0.2 * i, 0.2 * i},
              {}};
    if (i % 3 == 0) dot.bits = testing::Bits(Family().codes[static_cast<std::size_t>(40 + i)], 14);
    dot.turn_rad = change.turn_rad;
    if (change.streaks && i / 4 == 1 && i % 3 != 0) {
      const double y = dot.ellipse.y_px + dot.ellipse.semi_major_px + 2.5;
      dots.push_back({{dot.ellipse.x_px, y, 20.0, 0.8, 0.0}, {}});
    }
    dots.push_back(dot);
  }
  return Render(420, 320, dots, change.light * 3000.0, change.light * 300.0, 40.0,
                static_cast<unsigned>(frame + 1));
}

/// The same targets, with the error of a fit that has converged from wherever it began: what
/// adds less than three hundredths to a sigma, sqrt(1 + 0.25^2) - 1, and a twentieth as a rule.
/// Where changed light or something close by lets the fits use other pixels of the plateaus, more:
/// 0.4 adds less than eight hundredths.
void ExpectSame(const std::vector<Target>& a, const std::vector<Target>& b, int frame,
                double* squares, double most = 0.25) {
  ASSERT_EQ(a.size(), b.size()) << "frame " << frame;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Ellipse &e = a[i].edge.ellipse, &f = b[i].edge.ellipse;
    const double off[] = {e.x_px - f.x_px, e.y_px - f.y_px, e.semi_major_px - f.semi_major_px,
                          e.semi_minor_px - f.semi_minor_px};
    for (int k = 0; k < 4; ++k) {
      const double part = off[k] / std::sqrt(b[i].edge.cov(k, k));
      EXPECT_LE(std::abs(part), most) << "frame " << frame << ", target " << i << ", " << k;
      *squares += part * part;
    }
    EXPECT_EQ(a[i].ring.id, b[i].ring.id);
    EXPECT_EQ(a[i].ring.status, b[i].ring.status);
  }
}

TEST(TrackedRecognizerTest, GivesWhatTheWholeFramesSearchGives) {
  TrackedRecognizer tracked(FastOptions(), Family(), {}, std::nullopt);
  const Recognizer whole(FastOptions(), Family());
  double squares = 0.0;
  for (int frame = 0; frame < 30; ++frame) {
    const auto picture = Moving(frame);
    const TrackedFrame found = tracked.Next(picture.view());
    ASSERT_TRUE(tracked.camera());
    EXPECT_EQ(found.full, frame == 0);
    EXPECT_EQ(found.lost, 0) << "frame " << frame;
    EXPECT_EQ(found.targets.size(), 12u);
    ExpectSame(found.targets, whole.RecognizeFrames({picture.view()}, 1, &*tracked.camera())[0],
               frame, &squares);
  }
  EXPECT_LE(std::sqrt(squares / (30 * 12 * 4)), 0.05);
}

/// Frames 0 ... 29 by both, of which only the first is searched as a whole.
void FollowAll(const std::function<Change(int)>& change, double most, int* unclear) {
  TrackedRecognizer tracked(FastOptions(), Family(), {}, std::nullopt);
  const Recognizer whole(FastOptions(), Family());
  double squares = 0.0;
  for (int frame = 0; frame < 30; ++frame) {
    const auto picture = Moving(frame, change(frame));
    const TrackedFrame found = tracked.Next(picture.view());
    EXPECT_EQ(found.full, frame == 0);
    EXPECT_EQ(found.lost, 0) << "frame " << frame;
    ASSERT_EQ(found.targets.size(), 12u) << "frame " << frame;
    ExpectSame(found.targets, whole.RecognizeFrames({picture.view()}, 1, &*tracked.camera())[0],
               frame, &squares, most);
    for (const Target& target : found.targets) *unclear += target.edge.exact_axes ? 0 : 1;
  }
}

TEST(TrackedRecognizerTest, RingsMayTurn) {
  int unclear = 0;  // a sixth of a sector a frame, and a jump
  FollowAll([](int frame) { return Change{.turn_rad = 0.07 * frame + (frame > 20 ? 1.0 : 0.0)}; },
            0.25, &unclear);
  EXPECT_EQ(unclear, 0);
}

TEST(TrackedRecognizerTest, LightMayFlicker) {
  int unclear = 0;
  FollowAll([](int frame) { return Change{.light = 1.0 - 0.15 * (frame % 4)}; }, 0.4, &unclear);
}

TEST(TrackedRecognizerTest, UnclearDotsAreFollowedToo) {
  int unclear = 0;
  FollowAll([](int) { return Change{.streaks = true}; }, 0.4, &unclear);
  EXPECT_GE(unclear, 30);
}

TEST(TrackedRecognizerTest, SaysWhatIsLostAndFindsItAgain) {
  TrackedOptions options;
  options.full_every = 10;
  TrackedRecognizer tracked(FastOptions(), Family(), options, std::nullopt);
  for (int frame = 0; frame < 25; ++frame) {
    const bool hidden = frame >= 4 && frame < 13;
    const auto picture = Moving(frame, {.hidden = hidden ? 5 : -1});
    const TrackedFrame found = tracked.Next(picture.view());
    EXPECT_EQ(found.lost, frame == 4 ? 1 : 0) << "frame " << frame;
    // A whole search where it is lost, and with every tenth frame: there it is seen again.
    EXPECT_EQ(found.full, frame % 10 == 0 || frame == 4) << "frame " << frame;
    EXPECT_EQ(found.targets.size(), frame >= 4 && frame < 20 ? 11u : 12u) << "frame " << frame;
  }
}

TEST(TrackedRecognizerTest, SeesWhatIsNewBesideWhatItFollows) {
  TrackedOptions options;
  options.full_every = 1;
  TrackedRecognizer tracked(FastOptions(), Family(), options, std::nullopt);
  const Recognizer whole(FastOptions(), Family());
  double squares = 0.0;
  for (int frame = 0; frame < 12; ++frame) {
    const auto picture = Moving(frame, {.hidden = frame < 5 ? 6 : -1});  // one with a ring
    const TrackedFrame found = tracked.Next(picture.view());
    EXPECT_TRUE(found.full);
    EXPECT_EQ(found.lost, 0);
    ASSERT_EQ(found.targets.size(), frame < 5 ? 11u : 12u) << "frame " << frame;
    ExpectSame(found.targets, whole.RecognizeFrames({picture.view()}, 1, &*tracked.camera())[0],
               frame, &squares);
  }
}

TEST(TrackedRecognizerTest, WidensTheWindowOfWhatJumps) {
  TrackedRecognizer tracked(FastOptions(), Family(), {}, std::nullopt);
  for (int frame = 0; frame < 6; ++frame) {
    const double x = frame < 4 ? 100.0 : 109.0;  // beyond the margin of 4 px and the ground
    const auto picture = Render(200, 200, {{{x, 100.0, 6.0, 6.0, 0.0}, {}}}, 3000.0, 300.0, 40.0);
    const TrackedFrame found = tracked.Next(picture.view());
    EXPECT_EQ(found.targets.size(), 1u) << "frame " << frame;
    EXPECT_EQ(found.lost, 0);
    EXPECT_EQ(found.full, frame == 0);
  }
}

TEST(TrackedRecognizerTest, GoesThroughEmptyFrames) {
  TrackedRecognizer tracked(FastOptions(), Family(), {}, std::nullopt);
  const Picture<std::uint16_t> empty{420, 320, std::vector<std::uint16_t>(420 * 320, 300)};
  EXPECT_TRUE(tracked.Next(empty.view()).targets.empty());
  EXPECT_EQ(tracked.Next(Moving(0).view()).targets.size(), 12u);
  EXPECT_EQ(tracked.Next(empty.view()).lost, 12);
  EXPECT_EQ(tracked.Next(Moving(1).view()).targets.size(), 12u);
  EXPECT_TRUE(tracked.Next(ImageView8()).targets.empty());
}

TEST(TrackedRecognizerTest, RefusesWhatCannotBe) {
  TrackedOptions options;
  options.full_every = 0;
  EXPECT_THROW(TrackedRecognizer(FastOptions(), Family(), options, std::nullopt),
               std::invalid_argument);
  options = {};
  options.margin_px = 0.5;
  EXPECT_THROW(TrackedRecognizer(FastOptions(), Family(), options, std::nullopt),
               std::invalid_argument);
  RecognitionOptions paper = FastOptions();
  paper.method = kLocalCanny;
  EXPECT_THROW(TrackedRecognizer(paper, Family(), {}, std::nullopt), std::invalid_argument);
}

}  // namespace
}  // namespace videogrammetry
