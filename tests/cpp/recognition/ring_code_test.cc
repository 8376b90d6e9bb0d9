#include "videogrammetry/recognition/ring_code.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "synthetic_picture.h"
#include "videogrammetry/recognition/ring_confidence.h"
#include "videogrammetry/recognition/ring_sampling.h"

namespace videogrammetry {
namespace {

/// The circles on the ring.
std::array<RingCircle*, 3> Ring(RingSamples* s) { return {&s->inner, &s->middle, &s->outer}; }

/// Samples of an ideal ring that begins `turn` sectors late, its edges a sixteenth of
/// a sector wide as the dot's are, found to 0.02 px at sectors of 10 px.
RingSamples Ideal(const std::vector<int>& bits, double turn) {
  const int n = static_cast<int>(bits.size());
  RingSamples s;
  s.num_bits = n;
  s.outside.fill(0.0f);
  const auto value = [&](double place) {
    const int sector = ((static_cast<int>(std::floor(place)) % n) + n) % n;
    return bits[static_cast<std::size_t>(sector)] != 0 ? 1.0f : 0.0f;
  };
  for (int i = 0; i < n * kRingPerSector; ++i) {
    const auto at = static_cast<std::size_t>(i);
    float sum = 0;
    for (int j = 0; j < 16; ++j) {
      sum += value((i + 0.5 + (j - 7.5) / 16) / kRingPerSector - turn) / 16;
    }
    for (RingCircle* circle : Ring(&s)) (*circle)[at] = sum;
  }
  s.blur_along.fill(0.0625f);
  s.blur_across.fill(0.0625f);
  s.length_px.fill(10.0f);
  s.edge_sigma_px = 0.02f;
  s.grey_sigma = 0.01f;
  return s;
}

const CodeFamily& Family() {
  static const CodeFamily family = SchneiderFamily(14);
  return family;
}

/// The named families, made once.
const CodeFamily& Named(const std::string& name) {
  static std::map<std::string, CodeFamily> families;
  const auto found = families.find(name);
  if (found != families.end()) return found->second;
  return families.emplace(name, NamedCodeFamily(name)).first->second;
}

RingReading Read(const RingSamples& s) {
  return ReadRing(s, Family(), ReadingDirection::kClockwise);
}

TEST(RingCodeTest, ReadsEveryCodeAtEveryTurn) {
  for (std::size_t i = 0; i < Family().codes.size(); ++i) {
    const double turn = 0.06 * std::sin(static_cast<double>(i));
    const RingReading reading = Read(Ideal(testing::Bits(Family().codes[i], 14), turn));
    ASSERT_EQ(reading.status, RingStatus::kCoded) << i;
    ASSERT_EQ(reading.id, static_cast<int>(i) + 1);
  }
}

TEST(RingCodeTest, MirroredIsSaid) {
  int mirrored = 0, coded = 0;
  for (const std::uint32_t code : Family().codes) {
    const auto reading = Read(Ideal(testing::Bits(ReversedCode(code, 14), 14), 0.2));
    mirrored += reading.status == RingStatus::kMirrored;
    coded += reading.status == RingStatus::kCoded;
    // The rule is blind to the direction, so a mirrored code is in the table
    // too: as itself or as another. Counter-clockwise it is the right one.
    const auto right = ReadRing(Ideal(testing::Bits(ReversedCode(code, 14), 14), 0.2), Family(),
                                ReadingDirection::kCounterClockwise);
    ASSERT_EQ(right.id, Family().IdOf(code));
  }
  EXPECT_EQ(mirrored, 0);
  EXPECT_EQ(coded, 516);
  CodeFamily chiral = Family();  // a table with one direction of a chiral pair only
  chiral.codes = {0b00000000001011};
  chiral.Index();
  const auto reading = ReadRing(Ideal(testing::Bits(0b00000000001101, 14), 0.0), chiral,
                                ReadingDirection::kClockwise);
  EXPECT_EQ(reading.status, RingStatus::kMirrored);
  EXPECT_FALSE(reading.id.has_value());
}

TEST(RingCodeTest, OneWrongSectorIsNeverAnotherCode) {
  for (const std::uint32_t code : Family().codes) {
    for (int bit = 0; bit < 14; ++bit) {
      const auto reading = Read(Ideal(testing::Bits(code ^ (1u << bit), 14), 0.0));
      ASSERT_FALSE(reading.id.has_value());
    }
  }
}

/// Samples `from` ... `to` - 1 of a sector set to a value on all circles.
void Paint(RingSamples* s, int sector, int from, int to, float value) {
  for (RingCircle* circle : Ring(s)) {
    for (int i = from; i < to; ++i) {
      (*circle)[static_cast<std::size_t>(kRingPerSector * sector + i)] = value;
    }
  }
}

TEST(RingCodeTest, StatusSaysWhatIsWrong) {
  RingSamples grey = Ideal(testing::Bits(Family().codes[100], 14), 0.0);
  Paint(&grey, 0, 0, kRingPerSector, 0.5f);  // a sector in between
  EXPECT_EQ(Read(grey).status, RingStatus::kUnclear);
  // A bright sector that goes on over a quarter of a dark one.
  RingSamples off = Ideal(testing::Bits(0b00011100000111, 14), 0.0);
  ASSERT_TRUE(Read(off).id.has_value());
  Paint(&off, 6, 0, 2, 1.0f);
  EXPECT_EQ(Read(off).status, RingStatus::kEdgesOff);
  EXPECT_EQ(Read(Ideal(testing::Bits(0b00000000000001, 14), 0.0)).status, RingStatus::kNotInTable);
}

TEST(RingCodeTest, AHiddenPartShows) {
  // One end of a run stands 0.15 of a sector off: at 10 px and 0.054 px (kPlaceSigmaPx
  // with the noise) with 0.012 of a sector, s = 0.013, so exp(d^2 / 2 s^2) > 1e10
  // outweighs a prior of 0.001 and (sqrt(2 pi) s)^2 = 1e-3 for the two ends.
  RingSamples cut = Ideal(testing::Bits(0b00011100000111, 14), 0.0);
  Paint(&cut, 3, 0, 1, 0.0f);
  Paint(&cut, 3, 1, 2, 0.8f);
  EXPECT_EQ(Read(cut).status, RingStatus::kEdgesOff);
  // The remainder of a hidden sector: one of its 8 samples on the outer circle alone.
  RingSamples rest = Ideal(testing::Bits(0b00011100000111, 14), 0.0);
  ASSERT_TRUE(Read(rest).id.has_value());
  rest.outer[8 * kRingPerSector + 4] = 0.5f;
  EXPECT_FALSE(Read(rest).id.has_value());
  // A stroke between two like sectors.
  RingSamples stroke = Ideal(testing::Bits(0b00011100000111, 14), 0.0);
  Paint(&stroke, 8, 6, 8, 1.0f);
  Paint(&stroke, 9, 0, 2, 1.0f);
  EXPECT_FALSE(Read(stroke).id.has_value());
}

TEST(RingCodeTest, ConfidenceFallsWithTheNoise) {
  const auto bits = testing::Bits(Family().codes[0], 14);  // four changes: the least of all
  double last = 1.0;
  for (const float sigma_px : {0.02f, 0.1f, 0.2f, 0.4f, 0.8f}) {
    RingSamples s = Ideal(bits, 0.0);
    s.edge_sigma_px = sigma_px;
    s.grey_sigma = 0.4f * sigma_px;
    const RingReading reading = Read(s);
    EXPECT_LE(reading.confidence, last) << sigma_px;
    EXPECT_EQ(reading.id.has_value(), reading.confidence >= 0.999)
        << sigma_px << " " << reading.confidence << " " << static_cast<int>(reading.status);
    last = reading.confidence;
  }
  EXPECT_LT(last, 0.9999);  // rings of 13 and 15 sectors would stand almost as well
}

TEST(RingConfidenceTest, TellsGridsApart) {
  // Two opposite sectors of 16, read as 14: each 1/16 of a turn wide instead of 1/14,
  // every change (14/16 - 1) / 2 = -1/16 of a sector off.
  RingChanges changes;
  changes.count = 4;
  changes.border = {0, 1, 7, 8};
  changes.shift = {0.0625f, -0.0625f, 0.0625f, -0.0625f};
  changes.sigma.fill(0.02f);
  EXPECT_GT(ForeignProbability(changes, 14), 0.5);
  changes.shift = {0.02f, -0.01f, -0.02f, 0.01f};  // as noise would have it
  EXPECT_LT(ForeignProbability(changes, 14), 0.001);
}

TEST(RingConfidenceTest, IsTheTailOfTheNormalDistribution) {
  const float heights[] = {1.0f, 0.0f}, sigmas[] = {0.25f, 0.5f};  // 2 and 1 sigma
  // Q(2) + Q(1).
  EXPECT_NEAR(WrongSectorProbability(heights, sigmas, 2), 0.0227501 + 0.1586553, 1e-6);
}

TEST(RingCodeTest, LightMayFallOffAlongTheRing) {
  RingSamples s = Ideal(testing::Bits(Family().codes[200], 14), 0.05);
  for (RingCircle* circle : Ring(&s)) {
    for (std::size_t i = 0; i < 14 * kRingPerSector; ++i) {
      (*circle)[i] *= 0.8f + 0.35f * static_cast<float>(std::cos(0.0561 * static_cast<double>(i)));
    }
  }
  EXPECT_EQ(Read(s).id, 201);
}

TEST(RingCodeTest, OuterPartMayBeOutsideThePicture) {
  RingSamples s = Ideal(testing::Bits(Family().codes[200], 14), 0.05);
  for (std::size_t i = 0; i < 20; ++i) {
    s.outer[i] = s.outside[i / 2] = std::numeric_limits<float>::quiet_NaN();
  }
  EXPECT_EQ(Read(s).id, 201);
}

/// A picture of one target, and the dot as it was drawn.
struct Drawing {
  testing::Picture<std::uint16_t> picture;
  TargetEdge dot;
};

Drawing Draw(const std::vector<int>& bits, double semi_minor_px, double ring_inner = 2.0,
             double ring_outer = 3.0, double turn_rad = 1.234) {
  testing::Drawn shape;
  shape.ellipse = {44.3, 45.2, 10.0, semi_minor_px, 0.6};
  shape.bits = bits;
  shape.turn_rad = turn_rad;
  shape.ring_inner = ring_inner, shape.ring_outer = ring_outer;
  Drawing drawing{testing::Render(90, 90, {shape}, 3000.0, 300.0, 20.0), {}};
  drawing.dot.ellipse = shape.ellipse;
  drawing.dot.inside = 3000.0, drawing.dot.outside = 300.0;
  // The binomial's variance and the pixel's; a hundredth of the contrast as noise
  // over a slope of 1 / (sqrt(2 pi) 0.76) a pixel.
  drawing.dot.width_px = std::sqrt(0.5 + 1.0 / 12.0);
  drawing.dot.edge_rms_px = 20.0 / 2700.0 * 2.5 * drawing.dot.width_px;
  return drawing;
}

RingReading ReadDrawing(const Drawing& drawing, const CodeFamily& family,
                        InstructionSet set = DetectInstructionSet()) {
  const GreySampler picture(drawing.picture.view(), 1, set);
  return ReadRing(picture, drawing.dot, family, ReadingDirection::kClockwise);
}

TEST(RingCodeTest, ReadsPicturesByEverySetWithTheSameBits) {
  for (std::size_t i = 0; i < Family().codes.size(); i += 37) {
    for (const double minor : {10.0, 6.0, 3.5}) {
      const Drawing drawing = Draw(testing::Bits(Family().codes[i], 14), minor);
      const RingReading first = ReadDrawing(drawing, Family(), InstructionSet::kBaseline);
      ASSERT_EQ(first.id, static_cast<int>(i) + 1) << minor;
      EXPECT_GE(first.confidence, 0.999);
      for (const InstructionSet set : {InstructionSet::kAvx2, InstructionSet::kAvx512}) {
        if (set > DetectInstructionSet()) continue;
        const RingReading other = ReadDrawing(drawing, Family(), set);
        EXPECT_EQ(other.id, first.id);
        EXPECT_EQ(other.quality, first.quality);
        EXPECT_EQ(other.confidence, first.confidence);
      }
    }
  }
}

TEST(RingCodeTest, NoRingAndBrightGapAreSeenAtTheFirstLook) {
  EXPECT_EQ(ReadDrawing(Draw({}, 9.0), Family()).status, RingStatus::kNoRing);
  // A ring from 1.2 to 3: bright where the gap should be.
  EXPECT_EQ(ReadDrawing(Draw(testing::Bits(Family().codes[100], 14), 9.0, 1.2), Family()).status,
            RingStatus::kNoRing);
}

TEST(RingCodeTest, ACutRingIsSaid) {
  Drawing drawing = Draw(testing::Bits(Family().codes[100], 14), 9.0);
  drawing.picture.width = 66;  // 2.2 radii to the right of the centre, and a little
  std::vector<std::uint16_t> pixels;
  for (std::size_t y = 0; y < 90; ++y) {
    for (std::size_t x = 0; x < 66; ++x) pixels.push_back(drawing.picture.pixels[90 * y + x]);
  }
  drawing.picture.pixels = pixels;
  EXPECT_EQ(ReadDrawing(drawing, Family()).status, RingStatus::kRingCut);
}

/// A drawing of a code turned on by some sectors.
Drawing DrawTurned(std::uint32_t code, double sectors, double semi_minor_px = 8.0) {
  const double turn_rad = 1.234 + sectors * 2.0 * std::numbers::pi / 14.0;
  return Draw(testing::Bits(code, 14), semi_minor_px, 2.0, 3.0, turn_rad);
}

std::optional<RingReading> Follow(const Drawing& drawing, const RingReading& before) {
  return FollowRing(GreySampler(drawing.picture.view(), 1), drawing.dot, Family(), before);
}

TEST(FollowRingTest, FindsTheSameRingWhereItHasTurnedTo) {
  for (std::size_t i = 0; i < Family().codes.size(); i += 29) {
    for (const double minor : {10.0, 6.0, 4.0}) {
      const RingReading before = ReadDrawing(DrawTurned(Family().codes[i], 0.0, minor), Family());
      ASSERT_EQ(before.id, static_cast<int>(i) + 1);
      for (const double sectors : {-0.15, -0.06, 0.0, 0.1, 0.15}) {
        const auto now = Follow(DrawTurned(Family().codes[i], sectors, minor), before);
        ASSERT_TRUE(now) << i << " " << minor << " " << sectors;
        EXPECT_EQ(now->id, before.id);
        EXPECT_EQ(now->confidence, before.confidence);
        // Samples a quarter of a sector apart place a sharp edge to a sixth of that.
        EXPECT_NEAR(now->phase_sectors - before.phase_sectors, sectors, 0.045) << minor;
      }
    }
  }
}

TEST(FollowRingTest, FollowsARingAllAroundWithoutDrift) {
  RingReading ring = ReadDrawing(DrawTurned(Family().codes[100], 0.0), Family());
  const double first = ring.phase_sectors;
  for (int k = 1; k <= 160; ++k) {
    const auto now = Follow(DrawTurned(Family().codes[100], 0.1 * k), ring);
    ASSERT_TRUE(now) << k;
    ring = *now;
  }
  EXPECT_NEAR(ring.phase_sectors - first, 16.0, 0.045);
}

TEST(FollowRingTest, WhatIsNotTheSameIsNotTakenForIt) {
  const RingReading before = ReadDrawing(DrawTurned(Family().codes[100], 0.0), Family());
  ASSERT_TRUE(before.id);
  EXPECT_FALSE(Follow(DrawTurned(Family().codes[100], 0.35), before));
  EXPECT_FALSE(Follow(DrawTurned(Family().codes[100], 1.0), before));
  EXPECT_FALSE(Follow(Draw({}, 8.0), before));
  // Any other code, a sector more or less among them.
  for (std::uint32_t bit = 0; bit < 14; ++bit) {
    EXPECT_FALSE(Follow(DrawTurned(Family().codes[100] ^ (1u << bit), 0.0), before)) << bit;
  }
  for (std::size_t i = 0; i < Family().codes.size(); i += 7) {
    if (i == 100) continue;
    EXPECT_FALSE(Follow(DrawTurned(Family().codes[i], 0.0), before)) << i;
  }
  // What was no ID is read anew.
  RingReading unclear = before;
  unclear.status = RingStatus::kUnclear;
  EXPECT_FALSE(Follow(DrawTurned(Family().codes[100], 0.0), unclear));
}

/// Whether two codes are the same print, turned: as sectors of both numbers' multiple.
bool SamePrint(std::uint32_t a, int bits_a, std::uint32_t b, int bits_b) {
  const int fine = std::lcm(bits_a, bits_b);
  std::string one, other;
  for (const int bit : testing::Bits(a, bits_a)) {
    one.append(static_cast<std::size_t>(fine / bits_a), bit != 0 ? '1' : '0');
  }
  for (const int bit : testing::Bits(b, bits_b)) {
    other.append(static_cast<std::size_t>(fine / bits_b), bit != 0 ? '1' : '0');
  }
  return (one + one).find(other) != std::string::npos;
}

TEST(RingCodeTest, RingsOfOtherFamiliesAreRefused) {
  int shown = 0, same_print = 0;
  for (const std::string& printed : CodeFamilyNames()) {
    if (printed == "none") continue;
    const CodeFamily other = NamedCodeFamily(printed);
    for (std::size_t i = 0; i < other.codes.size(); i += 1 + other.codes.size() / 12) {
      const Drawing drawing = Draw(testing::Bits(other.codes[i], other.num_bits), 9.0,
                                   other.ring_inner, other.ring_outer);
      for (const std::string& expected : CodeFamilyNames()) {
        if (printed == expected || expected == "none") continue;
        const CodeFamily& family = Named(expected);
        const RingReading reading = ReadDrawing(drawing, family);
        ++shown;
        if (!reading.id) continue;
        // Nothing can tell schneider-8 and its halved sectors as schneider-16 apart.
        const std::uint32_t read = family.codes[static_cast<std::size_t>(*reading.id - 1)];
        EXPECT_EQ(family.ring_inner, other.ring_inner);
        EXPECT_TRUE(SamePrint(other.codes[i], other.num_bits, read, family.num_bits))
            << printed << " " << other.codes[i] << " read as " << expected << " " << read;
        ++same_print;
      }
    }
  }
  EXPECT_GT(shown, 500);
  EXPECT_GT(same_print, 0);
}

}  // namespace
}  // namespace videogrammetry
