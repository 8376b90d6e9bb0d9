#pragma once

#include "videogrammetry/core/cpu.h"

namespace videogrammetry {

/// W = sum over k of g_k r_k^T for three weights g and a row r of `width` numbers each,
/// and of it W W^T: xx, xy, xz, yy, yz, zz.
///
/// @param rows  `num_rows` pointers to `width` numbers, a multiple of eight.
/// @param weights  (num_rows, 3).
using WeightedRowsKernel = void (*)(const double* const* rows, const double* weights, int num_rows,
                                    int width, double* products);

/// The fastest one of a set (or of the nearest lower one that was built). Sums
/// are taken in another order by each set: they differ by rounding.
WeightedRowsKernel SelectWeightedRows(InstructionSet set);

#ifdef VIDEOGRAMMETRY_X86_KERNELS
void Avx2WeightedRows(const double* const* rows, const double* weights, int num_rows, int width,
                      double* products);
#endif

}  // namespace videogrammetry
