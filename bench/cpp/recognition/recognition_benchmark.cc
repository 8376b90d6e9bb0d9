// Time of the stages of recognition on a made-up picture of 2000 x 1333: dots
// of 20 px on uneven, noisy ground. Counters: targets found, bytes a second.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <random>
#include <vector>

#include "videogrammetry/recognition/bilinear.h"
#include "videogrammetry/recognition/candidate_search.h"
#include "videogrammetry/recognition/dual_conic.h"
#include "videogrammetry/recognition/edge_pair_search.h"
#include "videogrammetry/recognition/gradient_mask.h"
#include "videogrammetry/recognition/gradient_threshold.h"
#include "videogrammetry/recognition/recognize.h"

namespace videogrammetry {
namespace {

constexpr int kWidth = 2000, kHeight = 1333, kPitch = 100, kRadius = 10;

template <typename T>
const std::vector<T>& Pixels() {
  static const std::vector<T> pixels = [] {
    std::mt19937 random(1);
    std::normal_distribution<double> noise(0.0, 1.5);
    const double scale = sizeof(T) == 1 ? 1.0 : 16.0;
    std::vector<T> out(static_cast<std::size_t>(kWidth) * kHeight);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const double dx = std::remainder(x - 50.3, kPitch), dy = std::remainder(y - 50.7, kPitch);
        const double inside = 1.0 / (1.0 + std::exp(2.5 * (std::hypot(dx, dy) - kRadius)));
        const double ground = 20.0 + 6.0 * std::sin(0.9 * x) * std::sin(0.7 * y);
        const double grey = ground + inside * (180.0 - ground) + noise(random);
        out[static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x)] =
            static_cast<T>(std::max(0.0, scale * grey));
      }
    }
    return out;
  }();
  return pixels;
}

template <typename T>
ImageView<T> View() {
  return {Pixels<T>().data(), kWidth, kHeight};
}

template <typename T>
void GradientMask(benchmark::State& state) {
  const auto set = static_cast<InstructionSet>(state.range(0));
  if (set > DetectInstructionSet()) {
    state.SkipWithError("not on this processor");
    return;
  }
  const auto mask = SelectGradientMask<T>(set);
  std::vector<std::uint64_t> rises((kWidth + 63) / 64), falls(rises.size());
  for (auto _ : state) {
    for (int y = 0; y < kHeight; ++y) {
      mask(View<T>().row(y), kWidth, 8, rises.data(), falls.data());
      benchmark::DoNotOptimize(rises.data());
    }
  }
  state.SetBytesProcessed(state.iterations() * kWidth * kHeight *
                          static_cast<std::int64_t>(sizeof(T)));
  state.SetLabel(InstructionSetName(set));
}
BENCHMARK(GradientMask<std::uint8_t>)->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMicrosecond);
BENCHMARK(GradientMask<std::uint16_t>)->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMicrosecond);

template <typename T>
void Bilinear(benchmark::State& state) {
  const auto set = static_cast<InstructionSet>(state.range(0));
  if (set > DetectInstructionSet()) {
    state.SkipWithError("not on this processor");
    return;
  }
  const auto kernel = SelectBilinear<T>(set);
  std::vector<float> x(960), y(960), out(960);
  for (std::size_t k = 0; k < x.size(); ++k) {
    x[k] = 500.0f + 12.0f * static_cast<float>(std::cos(0.1 * static_cast<double>(k)));
    y[k] = 400.0f + 12.0f * static_cast<float>(std::sin(0.1 * static_cast<double>(k)));
  }
  for (auto _ : state) {
    kernel(View<T>().data(), kWidth, x.data(), y.data(), 960, out.data());
    benchmark::DoNotOptimize(out.data());
  }
  state.SetItemsProcessed(state.iterations() * 960);
  state.SetLabel(InstructionSetName(set));
}
BENCHMARK(Bilinear<std::uint8_t>)->Arg(0)->Arg(1)->Arg(2);
BENCHMARK(Bilinear<std::uint16_t>)->Arg(0)->Arg(1)->Arg(2);

template <typename T>
void Search(benchmark::State& state) {
  const SignedImage<T> image(View<T>(), 1);
  const int threshold = GradientThreshold(MeasureGreyStatistics(View<T>()));
  std::size_t count = 0;
  for (auto _ : state) count = FindCandidates(image, RecognitionOptions{}, threshold).size();
  state.counters["candidates"] = static_cast<double>(count);
}
BENCHMARK(Search<std::uint8_t>)->Unit(benchmark::kMicrosecond);
BENCHMARK(Search<std::uint16_t>)->Unit(benchmark::kMicrosecond);

/// The picture in a storage: 8 bit, 12 bit in 16, 12 bit packed.
FrameView Stored(std::int64_t bits) {
  if (bits == 8) return View<std::uint8_t>();
  if (bits == 16) return View<std::uint16_t>();
  static const std::vector<std::uint8_t> packed = [] {
    std::vector<std::uint8_t> out;
    const auto& samples = Pixels<std::uint16_t>();
    for (std::size_t i = 0; i + 1 < samples.size(); i += 2) {
      const int a = std::min<int>(samples[i], 4095), b = std::min<int>(samples[i + 1], 4095);
      for (const int byte : {a >> 4, (a & 15) << 4 | b >> 8, b & 255}) {
        out.push_back(static_cast<std::uint8_t>(byte));
      }
    }
    return out;
  }();
  return Packed12View(packed.data(), kWidth, kHeight, PackedOrder::kHighFirst);
}

// The floor of every search: each byte of the frame read once.
void MemoryRead(benchmark::State& state) {
  const std::int64_t bytes = kWidth * kHeight * (state.range(0) == 12 ? 3 : state.range(0) / 4) / 2;
  const auto* data = std::visit(
      [](const auto& view) { return reinterpret_cast<const unsigned char*>(view.data()); },
      Stored(state.range(0)));
  for (auto _ : state) {
    std::uint64_t sums[8] = {};
    for (std::int64_t i = 0; i + 64 <= bytes; i += 64) {
      std::uint64_t words[8];
      std::memcpy(words, data + i, sizeof(words));
      for (int k = 0; k < 8; ++k) sums[k] += words[k];
    }
    benchmark::DoNotOptimize(sums);
  }
  state.SetBytesProcessed(state.iterations() * bytes);
}
BENCHMARK(MemoryRead)->Arg(8)->Arg(16)->Arg(12)->Unit(benchmark::kMicrosecond);

void EdgePairs(benchmark::State& state) {
  const FrameView frame = Stored(state.range(0));
  const auto set = static_cast<InstructionSet>(state.range(1));
  if (set > DetectInstructionSet()) {
    state.SkipWithError("not on this processor");
    return;
  }
  std::size_t count = 0;
  for (auto _ : state) count = FindDotRegions(frame, 1, {5.0, 200.0}, set).size();
  state.counters["regions"] = static_cast<double>(count);
  state.SetLabel(InstructionSetName(set));
}
BENCHMARK(EdgePairs)->ArgsProduct({{8, 16, 12}, {0, 1, 2}})->Unit(benchmark::kMicrosecond);
/// The first dot found, as a start for what measures it anew.
template <typename T>
TargetEdge FirstEdge() {
  return Recognize(View<T>(), RecognitionOptions{}, SchneiderFamily(14)).front().edge;
}

template <typename T>
void DualConic(benchmark::State& state) {
  TargetEdge edge = FirstEdge<T>();
  const Ellipse e = edge.ellipse;
  WindowReader reader(View<T>(), 1);
  const int reach = kRadius + 6, x = static_cast<int>(e.x_px), y = static_cast<int>(e.y_px);
  double sigma = 0;
  for (auto _ : state) {
    const auto fit = FitDualConic(reader.Read(x - reach, y - reach, x + reach, y + reach), edge);
    if (fit) sigma = std::sqrt(fit->cov(0, 0));
  }
  state.counters["sigma_px"] = sigma;
}
BENCHMARK(DualConic<std::uint8_t>)->Unit(benchmark::kMicrosecond);
BENCHMARK(DualConic<std::uint16_t>)->Unit(benchmark::kMicrosecond);

template <typename T>
void Whole(benchmark::State& state) {
  const CodeFamily family = SchneiderFamily(14);
  std::size_t count = 0;
  double sigma = 0;
  for (auto _ : state) {
    const auto targets = Recognize(View<T>(), RecognitionOptions{}, family);
    count = targets.size();
    if (!targets.empty()) sigma = std::sqrt(targets.front().edge.cov(0, 0));
  }
  state.counters["targets"] = static_cast<double>(count);
  state.counters["sigma_px"] = sigma;
}
BENCHMARK(Whole<std::uint8_t>)->Unit(benchmark::kMicrosecond);
BENCHMARK(Whole<std::uint16_t>)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace videogrammetry
