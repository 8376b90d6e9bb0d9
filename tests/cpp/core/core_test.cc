#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cstdlib>
#include <stdexcept>
#include <vector>

#include "videogrammetry/core/cpu.h"
#include "videogrammetry/core/image_view.h"
#include "videogrammetry/core/median.h"
#include "videogrammetry/core/thread_pool.h"

namespace videogrammetry {
namespace {

TEST(ImageView, ReadsAWindowOfALargerPicture) {
  std::vector<std::uint8_t> samples(5 * 8);
  for (std::size_t i = 0; i < samples.size(); ++i) samples[i] = static_cast<std::uint8_t>(i);
  const ImageView8 window(samples.data() + 2 * 8 + 3, 4, 3, 8);
  EXPECT_EQ(window(0, 0), 19);
  EXPECT_EQ(window(3, 2), 38);
  EXPECT_TRUE(window.contains(3, 2));
  EXPECT_FALSE(window.contains(4, 2));
}

TEST(ImageView, RefusesAStrideShorterThanARow) {
  const std::array<std::uint8_t, 16> samples{};
  EXPECT_THROW(ImageView8(samples.data(), 5, 2, 4), std::invalid_argument);
  EXPECT_THROW(ImageView8(samples.data(), -1, 2, 4), std::invalid_argument);
}

TEST(Median, IsTheMiddleOrTheUpperOfTwo) {
  EXPECT_EQ(Median({3.0}), 3.0);
  EXPECT_EQ(Median({9.0, -1.0, 4.0}), 4.0);
  EXPECT_EQ(Median({9.0, -1.0, 4.0, 5.0}), 5.0);
  EXPECT_EQ(Median({2.0, 2.0, 1.0, 2.0}), 2.0);
}

TEST(ParallelFor, VisitsEveryIndexOnceWhateverTheThreads) {
  for (const int threads : {0, 1, 2, 7}) {
    std::vector<std::atomic<int>> visits(1000);
    ParallelFor(1000, threads, [&](int i) { ++visits[static_cast<std::size_t>(i)]; });
    for (const auto& v : visits) ASSERT_EQ(v.load(), 1) << threads << " threads";
  }
}

TEST(ParallelFor, PassesAnExceptionOn) {
  for (const int threads : {1, 3}) {
    EXPECT_THROW(ParallelFor(100, threads,
                             [](int i) {
                               if (i == 42) throw std::runtime_error("42");
                             }),
                 std::runtime_error);
  }
}

TEST(ParallelFor, RefusesANegativeNumberOfThreads) {
  EXPECT_THROW(ParallelFor(3, -1, [](int) {}), std::invalid_argument);
}

TEST(Cpu, TheEnvironmentLowersButNeverRaises) {
  const InstructionSet hardware = DetectInstructionSet();
#ifndef _WIN32
  ASSERT_EQ(setenv("VIDEOGRAMMETRY_ISA", "baseline", 1), 0);
  EXPECT_EQ(DetectInstructionSet(), InstructionSet::kBaseline);
  ASSERT_EQ(setenv("VIDEOGRAMMETRY_ISA", "avx512", 1), 0);
  EXPECT_EQ(DetectInstructionSet(), hardware);
  ASSERT_EQ(unsetenv("VIDEOGRAMMETRY_ISA"), 0);
#endif
  EXPECT_FALSE(InstructionSetName(hardware).empty());
}

}  // namespace
}  // namespace videogrammetry
