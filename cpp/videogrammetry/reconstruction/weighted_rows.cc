#include "videogrammetry/reconstruction/weighted_rows.h"

#include <algorithm>

namespace videogrammetry {
namespace {

constexpr int kLanes = 8;

void Baseline(const double* const* rows, const double* weights, int num_rows, int width,
              double* products) {
  std::fill_n(products, 6, 0.0);
  for (int begin = 0; begin < width; begin += kLanes) {
    double w[3][kLanes] = {};
    for (int k = 0; k < num_rows; ++k) {
      const double* row = rows[k] + begin;
      for (int axis = 0; axis < 3; ++axis) {
        const double g = weights[3 * k + axis];
        for (int lane = 0; lane < kLanes; ++lane) w[axis][lane] += g * row[lane];
      }
    }
    int at = 0;
    for (int a = 0; a < 3; ++a) {
      for (int b = a; b < 3; ++b, ++at) {
        for (int lane = 0; lane < kLanes; ++lane) products[at] += w[a][lane] * w[b][lane];
      }
    }
  }
}

}  // namespace

WeightedRowsKernel SelectWeightedRows([[maybe_unused]] InstructionSet set) {
#ifdef VIDEOGRAMMETRY_X86_KERNELS
  if (set >= InstructionSet::kAvx2) return Avx2WeightedRows;
#endif
  return Baseline;
}

}  // namespace videogrammetry
