// Time to unpack a 1024 x 1024 frame of 12 bits, beside a mere read of the same
// packed bytes and a copy of the unpacked ones: what memory allows.
#include <benchmark/benchmark.h>

#include <cstdint>
#include <cstring>
#include <numeric>
#include <random>
#include <vector>

#include "videogrammetry/sequence/packed12.h"

namespace videogrammetry {
namespace {

constexpr std::size_t kSamples = 1024 * 1024;
// Frames of a sequence follow one another; eight of them do not stay in a cache of 2 MB.
constexpr std::size_t kFrames = 8;
constexpr std::size_t kBytes = Packed12Bytes(kSamples);

const std::vector<std::uint8_t>& Packed() {
  static const std::vector<std::uint8_t> packed = [] {
    std::mt19937 random(1);
    std::vector<std::uint8_t> bytes(kFrames * kBytes);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random() & 255);
    return bytes;
  }();
  return packed;
}

void Unpack(benchmark::State& state) {
  const auto set = static_cast<InstructionSet>(state.range(0));
  if (set > DetectInstructionSet()) {
    state.SkipWithError("not on this processor");
    return;
  }
  const auto order = state.range(1) == 0 ? PackedOrder::kHighFirst : PackedOrder::kLowFirst;
  std::vector<std::uint16_t> samples(kSamples);
  std::size_t frame = 0;
  for (auto _ : state) {
    Unpack12(std::span(Packed()).subspan(frame * kBytes, kBytes), order, samples, set);
    benchmark::DoNotOptimize(samples.data());
    benchmark::ClobberMemory();
    frame = (frame + 1) % kFrames;
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations() * kBytes));
}
BENCHMARK(Unpack)
    ->ArgNames({"set", "low_first"})
    ->ArgsProduct({{0, 1}, {0, 1}})
    ->Unit(benchmark::kMicrosecond);

void ReadPackedBytes(benchmark::State& state) {
  std::size_t frame = 0;
  for (auto _ : state) {
    const std::uint8_t* const bytes = Packed().data() + frame * kBytes;
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i + 8 <= kBytes; i += 8) {
      std::uint64_t word;
      std::memcpy(&word, bytes + i, 8);
      sum += word;
    }
    benchmark::DoNotOptimize(sum);
    frame = (frame + 1) % kFrames;
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations() * kBytes));
}
BENCHMARK(ReadPackedBytes)->Unit(benchmark::kMicrosecond);

void CopySamples(benchmark::State& state) {
  const std::vector<std::uint16_t> from(kFrames * kSamples, 1);
  std::vector<std::uint16_t> to(kSamples);
  std::size_t frame = 0;
  for (auto _ : state) {
    std::memcpy(to.data(), from.data() + frame * kSamples, 2 * kSamples);
    benchmark::DoNotOptimize(to.data());
    benchmark::ClobberMemory();
    frame = (frame + 1) % kFrames;
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations() * 2 * kSamples));
}
BENCHMARK(CopySamples)->Unit(benchmark::kMicrosecond);

void Pack(benchmark::State& state) {
  std::vector<std::uint16_t> samples(kSamples);
  Unpack12(std::span(Packed()).first(kBytes), PackedOrder::kHighFirst, samples);
  std::vector<std::uint8_t> packed(kBytes);
  for (auto _ : state) {
    Pack12(samples, PackedOrder::kHighFirst, packed);
    benchmark::DoNotOptimize(packed.data());
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations() * kBytes));
}
BENCHMARK(Pack)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace videogrammetry
