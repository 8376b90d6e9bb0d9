// Plain loops that a compiler turns into whatever vectors it may assume.
#include <cstring>

#include "videogrammetry/recognition/edge_pair_kernels.h"

namespace videogrammetry::edge_pair {
namespace {

constexpr int kUnpacked = 16;

template <typename T>
inline void LoadRow(const std::uint8_t* p, int count, T* out) {
  std::memcpy(out, p, static_cast<std::size_t>(count) * sizeof(T));
}

// Pairs of packed samples.
template <Storage S>
inline void LoadPacked(const std::uint8_t* p, int count, std::uint16_t* out) {
  for (int i = 0; i < count / 2; ++i) {
    const int b0 = p[3 * i], b1 = p[3 * i + 1], b2 = p[3 * i + 2];
    const bool high = S == kPackedHighFirst;
    out[2 * i] = static_cast<std::uint16_t>(high ? (b0 << 4) | (b1 >> 4) : b0 | ((b1 & 15) << 8));
    out[2 * i + 1] =
        static_cast<std::uint16_t>(high ? ((b1 & 15) << 8) | b2 : (b1 >> 4) | (b2 << 4));
  }
}

/// What a storage's samples are held in.
template <Storage S>
struct Holder {
  using Type = std::uint16_t;
};
template <>
struct Holder<kBytes> {
  using Type = std::uint8_t;
};

template <Storage S>
inline void Load(const std::uint8_t* p, int count, typename Holder<S>::Type* out) {
  if constexpr (S == kBytes || S == kWords) {
    LoadRow(p, count, out);
  } else {
    LoadPacked<S>(p, count, out);
  }
}

// One bit from each of 64 bytes of 0 or 1: the product brings those of eight bytes
// together in the highest.
inline std::uint64_t Bits(const std::uint8_t* flags) {
  std::uint64_t bits = 0;
  for (int i = 0; i < 8; ++i) {
    std::uint64_t eight = 0;
    for (int k = 0; k < 8; ++k) eight |= std::uint64_t{flags[8 * i + k]} << (8 * k);
    bits |= ((eight * 0x0102040810204080ull) >> 56) << (8 * i);
  }
  return bits;
}

template <Storage S>
inline void Edges(const std::uint8_t* p, int threshold, std::uint64_t* rises,
                  std::uint64_t* falls) {
  using T = typename Holder<S>::Type;
  T samples[66];
  Load<S>(p, 66, samples);
  const T limit = static_cast<T>(threshold);
  std::uint8_t up[64], down[64];
  for (int i = 0; i < 64; ++i) {
    // Within the type, so that the lanes stay as narrow as the samples.
    const T a = samples[i], b = samples[i + 2], low = a < b ? a : b;
    up[i] = static_cast<T>(b - low) > limit;
    down[i] = static_cast<T>(a - low) > limit;
  }
  *rises = Bits(up);
  *falls = Bits(down);
}

template <Storage S>
inline void EdgesAbove(const std::uint8_t* p, int threshold, const Growth& growth,
                       std::uint64_t* rises, std::uint64_t* falls) {
  typename Holder<S>::Type samples[66];
  Load<S>(p, 66, samples);
  std::uint16_t low[66];  // less what the threshold grows by
  const auto from = static_cast<std::uint16_t>(growth.from);
  const auto factor = static_cast<std::uint32_t>(growth.per_grey);
  const auto most = static_cast<std::uint16_t>(growth.most);
  for (int i = 0; i < 66; ++i) {
    const std::uint16_t grey = samples[i];
    const auto over = static_cast<std::uint16_t>(grey > from ? grey - from : 0);
    const auto by = static_cast<std::uint16_t>(over * factor >> 16);
    low[i] = static_cast<std::uint16_t>(grey - (by < most ? by : most));
  }
  const auto limit = static_cast<std::uint16_t>(threshold);
  std::uint8_t up[64], down[64];
  for (int i = 0; i < 64; ++i) {
    const std::uint16_t a = samples[i], b = samples[i + 2];
    const auto rise = static_cast<std::uint16_t>(low[i + 2] > a ? low[i + 2] - a : 0);
    const auto fall = static_cast<std::uint16_t>(low[i] > b ? low[i] - b : 0);
    up[i] = rise > limit;
    down[i] = fall > limit;
  }
  *rises = Bits(up);
  *falls = Bits(down);
}

template <Storage S>
inline void Unpack(const std::uint8_t* p, std::uint16_t flip, std::uint16_t* out) {
  typename Holder<S>::Type samples[kUnpacked];
  Load<S>(p, kUnpacked, samples);
  for (int i = 0; i < kUnpacked; ++i) out[i] = static_cast<std::uint16_t>(samples[i] ^ flip);
}

}  // namespace
}  // namespace videogrammetry::edge_pair

#include "videogrammetry/recognition/edge_pair_kernels.inc"

const Kernels* BaselineKernels() { return kTable; }

}  // namespace videogrammetry::edge_pair
