#include "videogrammetry/recognition/code_family.h"

#include <gtest/gtest.h>

#include <bit>
#include <set>
#include <stdexcept>

namespace videogrammetry {
namespace {

TEST(CodeFamilyTest, SizesArePublished) {
  EXPECT_EQ(SchneiderFamily(8).codes.size(), 13u);
  EXPECT_EQ(SchneiderFamily(10).codes.size(), 42u);
  EXPECT_EQ(SchneiderFamily(12).codes.size(), 147u);
  EXPECT_EQ(SchneiderFamily(14).codes.size(), 516u);
  EXPECT_EQ(MetashapeFamily(12).codes.size(), 161u);
  EXPECT_EQ(MetashapeFamily(14).codes.size(), 561u);
}

TEST(CodeFamilyTest, CanonicalAndReversed) {
  EXPECT_EQ(CanonicalCode(0b1000, 4), 0b0001u);
  EXPECT_EQ(CanonicalCode(0b1101, 4), 0b0111u);
  EXPECT_EQ(ReversedCode(0b0001011, 7), 0b1101000u);
  for (std::uint32_t code = 0; code < 256; ++code) {
    EXPECT_EQ(ReversedCode(ReversedCode(code, 8), 8), code);
  }
}

TEST(CodeFamilyTest, EveryNamedFamilyIsConsistent) {
  for (const std::string& name : CodeFamilyNames()) {
    const CodeFamily family = NamedCodeFamily(name);
    EXPECT_EQ(family.name, name);
    EXPECT_NO_THROW(family.Check()) << name;
    for (std::size_t i = 0; i < family.codes.size(); ++i) {
      ASSERT_EQ(family.IdOf(family.codes[i]), static_cast<int>(i) + 1) << name;
      // One wrong sector is detected: no code becomes another by it.
      const std::uint32_t wrong = CanonicalCode(family.codes[i] ^ 1u, family.num_bits);
      ASSERT_FALSE(family.IdOf(wrong).has_value()) << name;
    }
  }
}

TEST(CodeFamilyTest, NamesCodesOneSectorApart) {
  for (const std::string& name : CodeFamilyNames()) {
    EXPECT_FALSE(OneSectorApart(NamedCodeFamily(name)).has_value()) << name;
  }
  CodeFamily family;
  family.num_bits = 8;
  family.codes = {0b00010001, 0b00001111, 0b00000111};  // 15 less one bit is 7
  family.Index();
  EXPECT_EQ(OneSectorApart(family), (std::pair{2, 3}));
}

TEST(CodeFamilyTest, ChecksAUsersTable) {
  CodeFamily family;
  family.num_bits = 4;
  family.codes = {1, 3, 7};
  family.Index();
  EXPECT_NO_THROW(family.Check());
  family.codes = {1, 1};
  family.Index();
  EXPECT_THROW(family.Check(), std::invalid_argument);
  family.codes = {2};
  family.Index();
  EXPECT_THROW(family.Check(), std::invalid_argument);
  family.codes = {1};
  family.Index();
  family.ring_outer = 1.5;
  EXPECT_THROW(family.Check(), std::invalid_argument);
  family.ring_outer = 3.0;
  EXPECT_NO_THROW(family.Check());
  family.codes = {1, 3};  // not indexed
  EXPECT_THROW(family.Check(), std::invalid_argument);
  family.codes = {15};  // no change along the ring
  family.Index();
  EXPECT_THROW(family.Check(), std::invalid_argument);
  EXPECT_THROW(NamedCodeFamily("schneider-13"), std::invalid_argument);
}

}  // namespace
}  // namespace videogrammetry
