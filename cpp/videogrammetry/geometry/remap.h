#pragma once

#include <cstdint>

#include "videogrammetry/core/image_view.h"

namespace videogrammetry {

/// How a picture is sampled between its pixels.
///   kLinear:  2 x 2 samples, triangle;
///   kCubic:   4 x 4 samples, Keys' cubic with a = -1/2 [1]: exact for quadratics;
///   kLanczos: 6 x 6 samples, sinc windowed by its own main lobe over 3 samples,
///             weights divided by their sum, the inner two made so that planes are exact.
///
/// [1] R. Keys, Cubic convolution interpolation for digital image processing,
///     IEEE Trans. Acoust., Speech, Signal Process. 29 (1981) 1153-1160, Eq. (15).
enum class Interpolation { kLinear, kCubic, kLanczos };

/// How Remap samples and what it writes where there is nothing to sample.
struct RemapOptions {
  Interpolation interpolation = Interpolation::kLanczos;
  /// Grey value of places that the source does not have.
  int fill = 0;
  /// Largest grey value: kernels with negative weights overshoot at edges.
  int largest = 65535;
  /// 0: one a core.
  int num_threads = 1;
};

/// Samples `source` at the places of a map: out(x, y) = source(map(x, y)).
///
/// A place outside [-0.5, w - 0.5) x [-0.5, h - 0.5), or one that is not finite,
/// gives `fill`. Nearer than a kernel's radius to the border, the outermost
/// samples stand for those beyond. Values are rounded to the nearest integer.
///
/// @param map_px  height x width places x, y in pixels of the source, row-major.
/// @param out     height x width samples, row-major; not the source itself.
/// @throws std::invalid_argument if the source is empty, or fill or largest is
///     negative or more than T holds.
template <typename T>
void Remap(const ImageView<T>& source, const double* map_px, int width, int height,
           const RemapOptions& options, T* out);

extern template void Remap(const ImageView8&, const double*, int, int, const RemapOptions&,
                           std::uint8_t*);
extern template void Remap(const ImageView16&, const double*, int, int, const RemapOptions&,
                           std::uint16_t*);

}  // namespace videogrammetry
