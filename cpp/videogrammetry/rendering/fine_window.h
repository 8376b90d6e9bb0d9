#pragma once

#include <vector>

#include "videogrammetry/rendering/local_map.h"

namespace videogrammetry {

/// A target as painted in a window, scale x scale cells a pixel, before the lens.
struct FineWindow {
  PixelWindow window;
  int scale = 1;
  std::vector<float> cover;  ///< share of the cell that hides what lies behind
  std::vector<float> light;  ///< light from that share

  int columns() const { return window.width() * scale; }
  int rows() const { return window.height() * scale; }
};

/// Lens and pixel in one: cells -> pixels.
///
/// A pixel's value is the scene convolved with the Gaussian of psf_sigma_px and
/// with the pixel's square, so that an edge has the spread
///   sigma_edge^2 = psf_sigma^2 + 1/12   [px^2].
/// Both are integrated over cells, not sampled on pixels: that would blur a
/// picture which is aliased already, and edges would err with their sub-pixel
/// phase. A cell's light counts with its area and, shared out to its
/// neighbours (PaintTarget), its centre of gravity, so that what is left is the
/// kernel's curvature over half a cell's second moment: h^3, h = 1/scale px.
class PsfKernel {
 public:
  explicit PsfKernel(double psf_sigma_px);

  int scale() const { return scale_; }          ///< cells a pixel and axis
  int radius_px() const { return radius_px_; }  ///< reach of a pixel beyond itself

  /// Adds a window of cells (row by row, window.width() * scale() a row) to a
  /// picture; what falls outside the picture is lost.
  void AddBlurred(const PixelWindow& window, const std::vector<float>& cells, int width, int height,
                  float* picture) const;

 private:
  int scale_ = 1;
  int radius_px_ = 0;
  std::vector<float> taps_;  // (2 radius + 1) * scale cells about a pixel
};

/// Convolves a picture with the Gaussian sampled at whole pixels, its border
/// pixels continued outwards: for backgrounds, which have no edges to measure.
void BlurPixels(double sigma_px, int width, int height, std::vector<float>* picture);

}  // namespace videogrammetry
