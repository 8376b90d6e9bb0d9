#include "videogrammetry/sequence/packed12.h"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "videogrammetry/sequence/packed12_kernels.h"

namespace videogrammetry {
namespace {

constexpr std::uint16_t kLargest = 0x0fff;

void CheckSizes(const char* name, std::size_t num_bytes, std::size_t num_samples) {
  if (num_bytes != Packed12Bytes(num_samples)) {
    throw std::invalid_argument(
        std::string(name) + ": " + std::to_string(num_samples) + " samples of 12 bits take " +
        std::to_string(Packed12Bytes(num_samples)) + " bytes, got " + std::to_string(num_bytes));
  }
}

template <PackedOrder kOrder>
void Unpack(const std::uint8_t* packed, std::uint16_t* samples, std::size_t num_samples) {
  for (std::size_t pair = 0; pair < num_samples / 2; ++pair) {
    const unsigned b0 = packed[3 * pair], b1 = packed[3 * pair + 1], b2 = packed[3 * pair + 2];
    if constexpr (kOrder == PackedOrder::kHighFirst) {
      samples[2 * pair] = static_cast<std::uint16_t>(b0 << 4 | b1 >> 4);
      samples[2 * pair + 1] = static_cast<std::uint16_t>((b1 & 15) << 8 | b2);
    } else {
      samples[2 * pair] = static_cast<std::uint16_t>(b0 | (b1 & 15) << 8);
      samples[2 * pair + 1] = static_cast<std::uint16_t>(b1 >> 4 | b2 << 4);
    }
  }
  if (num_samples % 2 == 1) {
    const std::size_t at = 3 * (num_samples / 2);
    const unsigned b0 = packed[at], b1 = packed[at + 1];
    samples[num_samples - 1] = static_cast<std::uint16_t>(
        kOrder == PackedOrder::kHighFirst ? b0 << 4 | b1 >> 4 : b0 | (b1 & 15) << 8);
  }
}

template <PackedOrder kOrder>
void Pack(const std::uint16_t* samples, std::size_t num_samples, std::uint8_t* packed) {
  for (std::size_t pair = 0; pair < num_samples / 2; ++pair) {
    const unsigned first = samples[2 * pair], second = samples[2 * pair + 1];
    std::uint8_t* const at = packed + 3 * pair;
    if constexpr (kOrder == PackedOrder::kHighFirst) {
      at[0] = static_cast<std::uint8_t>(first >> 4);
      at[1] = static_cast<std::uint8_t>((first & 15) << 4 | second >> 8);
      at[2] = static_cast<std::uint8_t>(second & 255);
    } else {
      at[0] = static_cast<std::uint8_t>(first & 255);
      at[1] = static_cast<std::uint8_t>(first >> 8 | (second & 15) << 4);
      at[2] = static_cast<std::uint8_t>(second >> 4);
    }
  }
  if (num_samples % 2 == 1) {
    const unsigned last = samples[num_samples - 1];
    std::uint8_t* const at = packed + 3 * (num_samples / 2);
    const bool high = kOrder == PackedOrder::kHighFirst;
    at[0] = static_cast<std::uint8_t>(high ? last >> 4 : last & 255);
    at[1] = static_cast<std::uint8_t>(high ? (last & 15) << 4 : last >> 8);
  }
}

}  // namespace

void Unpack12(std::span<const std::uint8_t> packed, PackedOrder order,
              std::span<std::uint16_t> samples, [[maybe_unused]] InstructionSet set) {
  CheckSizes("Unpack12", packed.size(), samples.size());
  std::size_t done = 0;
#ifdef VIDEOGRAMMETRY_X86_KERNELS
  if (set >= InstructionSet::kAvx2) {
    done =
        packed12::Avx2Unpack(packed.data(), packed.size(), order, samples.data(), samples.size());
  }
#endif
  const auto rest = samples.subspan(done);
  const std::uint8_t* const bytes = packed.data() + Packed12Bytes(done);
  if (order == PackedOrder::kHighFirst) {
    Unpack<PackedOrder::kHighFirst>(bytes, rest.data(), rest.size());
  } else {
    Unpack<PackedOrder::kLowFirst>(bytes, rest.data(), rest.size());
  }
}

void Pack12(std::span<const std::uint16_t> samples, PackedOrder order,
            std::span<std::uint8_t> packed) {
  CheckSizes("Pack12", packed.size(), samples.size());
  std::uint16_t bits = 0;  // any bit above the twelfth, in a loop without a branch
  for (const std::uint16_t sample : samples) bits |= sample;
  if (bits > kLargest) {
    const auto wrong =
        std::find_if(samples.begin(), samples.end(), [](auto sample) { return sample > kLargest; });
    throw std::invalid_argument("Pack12: sample " + std::to_string(wrong - samples.begin()) +
                                " is " + std::to_string(*wrong) +
                                ", the largest of 12 bits is 4095");
  }
  if (order == PackedOrder::kHighFirst) {
    Pack<PackedOrder::kHighFirst>(samples.data(), samples.size(), packed.data());
  } else {
    Pack<PackedOrder::kLowFirst>(samples.data(), samples.size(), packed.data());
  }
}

}  // namespace videogrammetry
