#include "videogrammetry/recognition/ring_code.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "synthetic_picture.h"

namespace videogrammetry {
namespace {

constexpr int kPerSector = 12;

/// Samples of an ideal ring that begins `turn` sectors late.
RingSamples Ideal(const std::vector<int>& bits, double turn) {
  const int n = static_cast<int>(bits.size());
  RingSamples s;
  s.per_sector = kPerSector;
  for (int i = 0; i < n * kPerSector; ++i) {
    const double place = static_cast<double>(i) / kPerSector - turn;
    const int sector = ((static_cast<int>(std::floor(place)) % n) + n) % n;
    const float v = bits[static_cast<std::size_t>(sector)] != 0 ? 1.0f : 0.0f;
    s.inner.push_back(v);
    s.middle.push_back(v);
    s.outer.push_back(v);
    s.gap.push_back(0.0f);
    s.outside.push_back(0.0f);
  }
  return s;
}

const CodeFamily& Family() {
  static const CodeFamily family = SchneiderFamily(14);
  return family;
}

RingReading Read(const RingSamples& s) {
  return ReadRing(s, Family(), ReadingDirection::kClockwise);
}

TEST(RingCodeTest, ReadsEveryCodeAtEveryTurn) {
  for (std::size_t i = 0; i < Family().codes.size(); ++i) {
    const double turn = 0.37 * static_cast<double>(i);
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

TEST(RingCodeTest, StatusSaysWhatIsWrong) {
  const auto bits = testing::Bits(Family().codes[100], 14);
  EXPECT_EQ(Read(Ideal(std::vector<int>(14, 0), 0.0)).status, RingStatus::kNoRing);
  RingSamples bright_gap = Ideal(bits, 0.0);
  bright_gap.gap.assign(bright_gap.gap.size(), 0.9f);
  EXPECT_EQ(Read(bright_gap).status, RingStatus::kNoRing);
  RingSamples grey = Ideal(bits, 0.0);
  for (int k = 0; k < kPerSector; ++k) {
    for (auto* circle : {&grey.inner, &grey.middle, &grey.outer}) {
      (*circle)[static_cast<std::size_t>(k)] = 0.5f;  // a sector in between
    }
  }
  EXPECT_EQ(Read(grey).status, RingStatus::kUnclear);
  // A bright sector that goes on over 5/12 of a dark one.
  RingSamples off = Ideal(testing::Bits(0b00011100000011, 14), 0.0);
  for (int k = 6 * kPerSector; k < 6 * kPerSector + 5; ++k) {
    for (auto* circle : {&off.inner, &off.middle, &off.outer}) {
      (*circle)[static_cast<std::size_t>(k)] = 1.0f;
    }
  }
  EXPECT_EQ(Read(off).status, RingStatus::kEdgesOff);
  EXPECT_EQ(Read(Ideal(testing::Bits(0b00000000000001, 14), 0.0)).status, RingStatus::kNotInTable);
}

TEST(RingCodeTest, LightMayFallOffAlongTheRing) {
  RingSamples s = Ideal(testing::Bits(Family().codes[200], 14), 0.3);
  for (auto* circle : {&s.inner, &s.middle, &s.outer}) {
    for (std::size_t i = 0; i < circle->size(); ++i) {
      (*circle)[i] *= 0.8f + 0.35f * static_cast<float>(std::cos(0.0374 * static_cast<double>(i)));
    }
  }
  EXPECT_EQ(Read(s).id, 201);
}

TEST(RingCodeTest, OuterPartMayBeOutsideThePicture) {
  RingSamples s = Ideal(testing::Bits(Family().codes[200], 14), 0.3);
  for (std::size_t i = 0; i < 30; ++i) {
    s.outer[i] = s.outside[i] = std::numeric_limits<float>::quiet_NaN();
  }
  EXPECT_EQ(Read(s).id, 201);
}

}  // namespace
}  // namespace videogrammetry
