#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace videogrammetry {

/// How two samples of 12 bits stand in three bytes b0 b1 b2.
enum class PackedOrder {
  /// Most significant bit first, as in Photron's .mraw files:
  /// first = b0 << 4 | b1 >> 4, second = (b1 & 15) << 8 | b2.
  kHighFirst,
  /// Least significant bit first, as in GenICam's Mono12p:
  /// first = b0 | (b1 & 15) << 8, second = b1 >> 4 | b2 << 4.
  kLowFirst,
};

/// Bytes that `num_samples` samples of 12 bits take: (3 n + 1) / 2, so that half
/// a byte is left over after an odd number of samples.
constexpr std::size_t Packed12Bytes(std::size_t num_samples) {
  return num_samples + (num_samples + 1) / 2;
}

/// A picture of packed 12-bit samples in memory that someone else owns: one
/// picture without gaps, as cameras write it. Axes as in ImageView.
class Packed12View {
 public:
  Packed12View() = default;

  /// @param data  Packed12Bytes(width * height) bytes.
  /// @throws std::invalid_argument if a size is negative or the width is odd
  ///     (a row would begin in the middle of a byte).
  Packed12View(const std::uint8_t* data, int width, int height, PackedOrder order)
      : data_(data), width_(width), height_(height), order_(order) {
    if (width < 0 || height < 0 || width % 2 != 0) {
      throw std::invalid_argument("Packed12View: width " + std::to_string(width) + ", height " +
                                  std::to_string(height) +
                                  "; sizes must be >= 0 and the width even");
    }
  }

  /// The row's first byte; sample x stands in the bytes from 3 (x / 2) on.
  const std::uint8_t* row(int y) const { return data_ + y * stride_bytes(); }
  std::ptrdiff_t stride_bytes() const { return std::ptrdiff_t{width_} / 2 * 3; }
  int operator()(int x, int y) const {
    const std::uint8_t* b = row(y) + x / 2 * 3;
    if (order_ == PackedOrder::kHighFirst) {
      return x % 2 == 0 ? (b[0] << 4) | (b[1] >> 4) : ((b[1] & 15) << 8) | b[2];
    }
    return x % 2 == 0 ? b[0] | ((b[1] & 15) << 8) : (b[1] >> 4) | (b[2] << 4);
  }
  const std::uint8_t* data() const { return data_; }
  int width() const { return width_; }
  int height() const { return height_; }
  PackedOrder order() const { return order_; }

 private:
  const std::uint8_t* data_ = nullptr;
  int width_ = 0;
  int height_ = 0;
  PackedOrder order_ = PackedOrder::kHighFirst;
};

}  // namespace videogrammetry
