#include "videogrammetry/sequence/packed12.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace videogrammetry {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Samples = std::vector<std::uint16_t>;

constexpr PackedOrder kOrders[] = {PackedOrder::kHighFirst, PackedOrder::kLowFirst};

std::vector<InstructionSet> Sets() {
  std::vector<InstructionSet> sets = {InstructionSet::kBaseline};
  if (DetectInstructionSet() >= InstructionSet::kAvx2) sets.push_back(InstructionSet::kAvx2);
  return sets;
}

Bytes Pack(const Samples& samples, PackedOrder order) {
  Bytes packed(Packed12Bytes(samples.size()), 0xcc);
  Pack12(samples, order, packed);
  return packed;
}

Samples Unpack(const Bytes& packed, std::size_t count, PackedOrder order, InstructionSet set) {
  Samples samples(count, 0xcccc);
  Unpack12(packed, order, samples, set);
  return samples;
}

TEST(Packed12, BytesWorkedByHand) {
  // 0xabc, 0xdef: high first they are read as they are written; low first the
  // bytes of 0xdefabc from the least significant on.
  EXPECT_EQ(Pack({0xabc, 0xdef}, PackedOrder::kHighFirst), (Bytes{0xab, 0xcd, 0xef}));
  EXPECT_EQ(Pack({0xabc, 0xdef}, PackedOrder::kLowFirst), (Bytes{0xbc, 0xfa, 0xde}));
  for (const InstructionSet set : Sets()) {
    EXPECT_EQ(Unpack({0xab, 0xcd, 0xef}, 2, PackedOrder::kHighFirst, set), (Samples{0xabc, 0xdef}));
    EXPECT_EQ(Unpack({0xbc, 0xfa, 0xde}, 2, PackedOrder::kLowFirst, set), (Samples{0xabc, 0xdef}));
  }
}

TEST(Packed12, OddCountLeavesHalfAByte) {
  EXPECT_EQ(Packed12Bytes(0), 0u);
  EXPECT_EQ(Packed12Bytes(1), 2u);
  EXPECT_EQ(Packed12Bytes(2), 3u);
  EXPECT_EQ(Packed12Bytes(3), 5u);
  EXPECT_EQ(Pack({0x123, 0x456, 0x789}, PackedOrder::kHighFirst),
            (Bytes{0x12, 0x34, 0x56, 0x78, 0x90}));
  EXPECT_EQ(Pack({0x123, 0x456, 0x789}, PackedOrder::kLowFirst),
            (Bytes{0x23, 0x61, 0x45, 0x89, 0x07}));
  // What stands in the four bits left over does not matter.
  for (const InstructionSet set : Sets()) {
    EXPECT_EQ(Unpack({0x12, 0x34, 0x56, 0x78, 0x9f}, 3, PackedOrder::kHighFirst, set),
              (Samples{0x123, 0x456, 0x789}));
    EXPECT_EQ(Unpack({0x23, 0x61, 0x45, 0x89, 0xf7}, 3, PackedOrder::kLowFirst, set),
              (Samples{0x123, 0x456, 0x789}));
  }
}

TEST(Packed12, EveryValueComesBackInBothPlaces) {
  Samples samples;
  for (std::uint16_t value = 0; value < 4096; ++value) {
    samples.push_back(value);
    samples.push_back(static_cast<std::uint16_t>(4095 - value));
  }
  for (const PackedOrder order : kOrders) {
    for (const InstructionSet set : Sets()) {
      EXPECT_EQ(Unpack(Pack(samples, order), samples.size(), order, set), samples);
    }
  }
}

TEST(Packed12, EveryLengthComesBackAndNothingBeyondIsTouched) {
  // 100 samples pass through the vector kernel, its tail and the odd end.
  for (std::size_t count = 0; count < 100; ++count) {
    Samples samples(count);
    for (std::size_t i = 0; i < count; ++i) {
      samples[i] = static_cast<std::uint16_t>((2654435761u * (i + 1)) >> 20 & 4095);
    }
    for (const PackedOrder order : kOrders) {
      const Bytes packed = Pack(samples, order);
      for (const InstructionSet set : Sets()) {
        Samples out(count + 16, 0xcccc);
        Unpack12(packed, order, std::span(out).first(count), set);
        const Samples beyond(out.begin() + static_cast<std::ptrdiff_t>(count), out.end());
        out.resize(count);
        EXPECT_EQ(out, samples) << count << " samples, order " << static_cast<int>(order);
        EXPECT_EQ(beyond, Samples(16, 0xcccc)) << count;
      }
    }
  }
}

TEST(Packed12, WrongSizesAreRefused) {
  Samples samples(4);
  for (const std::size_t wrong : {0u, 5u, 7u}) {
    Bytes packed(wrong);
    EXPECT_THROW(Unpack12(packed, PackedOrder::kHighFirst, samples), std::invalid_argument);
    EXPECT_THROW(Pack12(samples, PackedOrder::kHighFirst, packed), std::invalid_argument);
  }
  try {
    Unpack12(Bytes(7), PackedOrder::kLowFirst, samples);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "Unpack12: 4 samples of 12 bits take 6 bytes, got 7");
  }
}

TEST(Packed12, ValuesAboveTwelveBitsAreRefusedAndNothingIsWritten) {
  for (const std::uint16_t value : {4096, 5000, 65535}) {
    const Samples samples = {1, 4095, 3, value};
    Bytes packed(6, 0xcc);
    try {
      Pack12(samples, PackedOrder::kHighFirst, packed);
      FAIL() << value;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(error.what(), "Pack12: sample 3 is " + std::to_string(value) +
                                  ", the largest of 12 bits is 4095");
    }
    EXPECT_EQ(packed, Bytes(6, 0xcc));
  }
}

}  // namespace
}  // namespace videogrammetry
