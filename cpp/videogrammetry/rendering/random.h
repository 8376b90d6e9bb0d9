#pragma once

#include <cstdint>

namespace videogrammetry {

/// Sixty-four mixed bits of a counter: SplitMix64's output function (Steele,
/// Lea, Flood, OOPSLA 2014), so that the n-th number needs none before it and
/// no thread's order is seen.
inline std::uint64_t MixedBits(std::uint64_t counter) {
  std::uint64_t z = counter * 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

/// Uniform in (0, 1), 53 bits.
inline double UniformOf(std::uint64_t bits) {
  return (static_cast<double>(bits >> 11) + 0.5) * 0x1p-53;
}

}  // namespace videogrammetry
