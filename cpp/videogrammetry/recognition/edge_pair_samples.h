#pragma once

// Private to the edge-pair search: a picture's rows in whatever storage, and the
// kernels to read them with.

#include <cstddef>
#include <cstdint>

#include "videogrammetry/core/cpu.h"
#include "videogrammetry/recognition/edge_pair_kernels.h"
#include "videogrammetry/recognition/grey_window.h"

namespace videogrammetry::edge_pair {

/// Values are what dots are bright in: I for bright dots, 65535 - I for dark ones.
struct SampleRows {
  SampleRows(const FrameView& frame, int sign, InstructionSet set);

  const std::uint8_t* row(int y) const { return data + y * stride_bytes; }
  /// Values of `count` pixels of a row from an even x on; see Kernels::samples.
  void Read(int x, int y, int count, std::uint16_t* out) const {
    kernels->samples(row(y), width, x, count, flip, out);
  }

  const std::uint8_t* data = nullptr;
  std::ptrdiff_t stride_bytes = 0;
  int width = 0, height = 0;
  std::uint16_t flip = 0;  ///< 65535 for dark dots
  Storage storage = kBytes;
  const Kernels* kernels = nullptr;
};

}  // namespace videogrammetry::edge_pair
