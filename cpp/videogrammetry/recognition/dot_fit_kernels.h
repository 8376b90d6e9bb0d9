#pragma once

// Private to dot_fit.cc: the same kernels for each instruction set. The files
// that define them are compiled with flags of their own, so nothing that is
// inlined elsewhere may be defined or instantiated in them.

#include <cstddef>

namespace videogrammetry::dot_fit {

/// Pixels are handled in groups of this many; arrays are padded to it.
inline constexpr int kGroup = 32;

/// Unknowns, those of no further interest first: grey values of the dot and of
/// its surroundings, the light's gradient, the blur, the shape's E_xx, E_xy,
/// E_yy, the centre.
enum Parameter { kIn, kOut, kLightX, kLightY, kBlur, kExx, kExy, kEyy, kX, kY, kNumParameters };
inline constexpr int kNumProducts = kNumParameters * (kNumParameters + 1) / 2;

/// sxx x^2 + 2 sxy x y + syy y^2 <= 1 around (x, y) = (cx, cy).
struct Conic {
  float cx, cy, sxx, sxy, syy;
};

/// Pixels as arrays of `count`, padded with copies that weigh nothing.
struct Pixels {
  const float* x;
  const float* y;
  const float* grey;
  int count;
};

/// Where the fit stands.
struct State {
  float value[kNumParameters];
  Conic light;  ///< only centre and V = (sxx, sxy, syy): the light's v = V (p - centre)
  float noise_at_zero, noise_per_grey, noise_least;
  float huber;    ///< deviations beyond which a pixel counts less
  bool plateaus;  ///< sum what Sums has of the plateaus too, which costs time
};

/// J^T W J (upper triangle, row by row), J^T W r and what the residuals sum to.
struct Sums {
  float product[kNumProducts];
  float right[kNumParameters];
  float squares;        ///< weighted, of the residuals
  float plain_squares;  ///< the same, outliers at full weight
  /// Where State::plateaus, unweighted, of pixels inside the edge,
  float bright_squares, bright_count;
  float dark_squares, dark_count;  ///< and beyond it
};

struct Kernels {
  /// Collects the pixels of a window within `outer` and not within `inner` (may be
  /// null), coordinates in the window's pixels, written less `origin`.
  /// @return their number; arrays hold kGroup more.
  int (*select)(const float* window, std::ptrdiff_t stride, int width, int height,
                const Conic& outer, const Conic* inner, float origin_x, float origin_y, float* x,
                float* y, float* grey);
  /// Sums of a, a x, a y, a x^2, a x y, a y^2 over the pixels; a is the grey value from
  /// 0 at `out` to 1 at `in`, and no less or more.
  void (*moments)(const Pixels& pixels, float in, float out, float* sums);
  /// @param rows  scratch for kNumParameters + 2 floats a pixel.
  void (*linearise)(const Pixels& pixels, const State& state, float* rows, Sums* sums);
  /// The same with the derivatives of an earlier state: all but sums->product.
  void (*revise)(const Pixels& pixels, const State& state, const float* rows, Sums* sums);
};

const Kernels& BaselineKernels();
const Kernels& Avx2Kernels();
const Kernels& Avx512Kernels();

}  // namespace videogrammetry::dot_fit
