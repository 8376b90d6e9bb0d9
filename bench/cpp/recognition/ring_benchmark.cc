// Time of reading a ring: 14 bits around dots of 12 px, and dots without a ring, by
// every instruction set; and of following one that is known.
#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "videogrammetry/recognition/ring_code.h"

namespace videogrammetry {
namespace {

constexpr int kSize = 64, kPictures = 64;
constexpr double kRadius = 6.0;

const CodeFamily& Family() {
  static const CodeFamily family = SchneiderFamily(14);
  return family;
}

struct Sight {
  std::vector<std::uint8_t> pixels;
  TargetEdge dot;
  FrameView view() const { return ImageView8(pixels.data(), kSize, kSize); }
};

/// Targets of a soft edge (a logistic of 0.8 px), somewhat tilted, each another code.
std::vector<Sight> Sights(bool coded) {
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0.0, 1.5);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  std::vector<Sight> sights(kPictures);
  for (int p = 0; p < kPictures; ++p) {
    Sight& sight = sights[static_cast<std::size_t>(p)];
    const std::uint32_t code = Family().codes[static_cast<std::size_t>(8 * p)];
    Ellipse& e = sight.dot.ellipse;
    e.x_px = 31.5 + uniform(random), e.y_px = 31.5 + uniform(random);
    e.semi_major_px = kRadius, e.semi_minor_px = kRadius * (0.8 + 0.2 * uniform(random));
    e.angle_rad = 3.0 * uniform(random);
    const double turn = uniform(random), c = std::cos(e.angle_rad), s = std::sin(e.angle_rad);
    for (int y = 0; y < kSize; ++y) {
      for (int x = 0; x < kSize; ++x) {
        double mean = 0;  // of 4 x 4 points over two pixels
        for (int i = 0; i < 64; ++i) {
          const double dx = x + (i % 8 - 3.5) / 4 - e.x_px, dy = y + (i / 8 - 3.5) / 4 - e.y_px;
          const double u = (c * dx + s * dy) / e.semi_major_px;
          const double v = (c * dy - s * dx) / e.semi_minor_px;
          const double radius = std::hypot(u, v);
          const double place = 14 * (std::atan2(v, u) / (2 * std::numbers::pi) + 1 + turn);
          const bool bright = ((code >> (13 - static_cast<int>(place) % 14)) & 1) != 0;
          mean += radius <= 1 || (coded && bright && radius >= 2 && radius <= 3) ? 1.0 / 64 : 0.0;
        }
        sight.pixels.push_back(static_cast<std::uint8_t>(20 + 200 * mean + 3 + noise(random)));
      }
    }
    sight.dot.inside = 223, sight.dot.outside = 23;
    sight.dot.edge_rms_px = 0.02, sight.dot.width_px = 0.7;
  }
  return sights;
}

enum Way { kNoRing, kRead, kFollowed };

/// Arguments: instruction set, way.
void ReadRings(benchmark::State& state) {
  const auto set = static_cast<InstructionSet>(state.range(0));
  if (set > DetectInstructionSet()) {
    state.SkipWithError("not on this processor");
    return;
  }
  const int way = static_cast<int>(state.range(1));
  static const std::vector<Sight> all[2] = {Sights(false), Sights(true)};
  const auto& sights = all[way == kNoRing ? 0 : 1];
  std::vector<GreySampler> pictures;
  std::vector<RingReading> before;
  for (const Sight& sight : sights) {
    pictures.emplace_back(sight.view(), 1, set);
    before.push_back(ReadRing(pictures.back(), sight.dot, Family(), ReadingDirection::kClockwise));
  }
  std::size_t read = 0, at = 0;
  for (auto _ : state) {
    at = (at + 1) % sights.size();
    const TargetEdge& dot = sights[at].dot;
    if (way == kFollowed) {
      read += FollowRing(pictures[at], dot, Family(), before[at]) ? 1 : 0;
    } else {
      const auto ring = ReadRing(pictures[at], dot, Family(), ReadingDirection::kClockwise);
      read += ring.id ? 1 : 0;
    }
  }
  state.counters["read"] = static_cast<double>(read) / static_cast<double>(state.iterations());
  const char* const ways[] = {" no ring", " read", " followed"};
  state.SetLabel(std::string(InstructionSetName(set)) + ways[way]);
}
BENCHMARK(ReadRings)->ArgsProduct({{0, 1, 2}, {kNoRing, kRead, kFollowed}});

}  // namespace
}  // namespace videogrammetry
