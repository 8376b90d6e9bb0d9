#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace videogrammetry {

/// A picture in memory that someone else owns: rows of samples of type T.
///
/// Pixel (0, 0) is the top-left pixel and its centre has the coordinates
/// (0, 0); x runs to the right, y down. Rows may be further apart than they
/// are long (`stride`), so that a window of a larger picture is a view too.
template <typename T>
class ImageView {
 public:
  ImageView() = default;

  /// @param stride  samples (not bytes) from one row's start to the next's.
  /// @throws std::invalid_argument if a size is negative or stride < width.
  ImageView(const T* data, int width, int height, std::ptrdiff_t stride)
      : data_(data), width_(width), height_(height), stride_(stride) {
    if (width < 0 || height < 0 || stride < width) {
      throw std::invalid_argument("ImageView: width " + std::to_string(width) + ", height " +
                                  std::to_string(height) + ", stride " + std::to_string(stride) +
                                  "; sizes must be >= 0 and stride >= width");
    }
  }
  ImageView(const T* data, int width, int height) : ImageView(data, width, height, width) {}

  const T* row(int y) const { return data_ + y * stride_; }
  T operator()(int x, int y) const { return row(y)[x]; }
  const T* data() const { return data_; }
  int width() const { return width_; }
  int height() const { return height_; }
  std::ptrdiff_t stride() const { return stride_; }
  bool contains(int x, int y) const { return x >= 0 && y >= 0 && x < width_ && y < height_; }

 private:
  const T* data_ = nullptr;
  int width_ = 0;
  int height_ = 0;
  std::ptrdiff_t stride_ = 0;
};

using ImageView8 = ImageView<std::uint8_t>;
using ImageView16 = ImageView<std::uint16_t>;

}  // namespace videogrammetry
