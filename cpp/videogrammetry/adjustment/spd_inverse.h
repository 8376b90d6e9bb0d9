#pragma once

#include <Eigen/Core>

namespace videogrammetry {

/// Replaces the lower triangle of a symmetric positive definite matrix by its
/// Cholesky factor L, A = L L'; the strict upper triangle is left as it is.
/// @return the smallest pivot L_ii^2, not positive (or NaN) where the matrix is not
///     positive definite.
double FactorInPlace(Eigen::MatrixXd* a, int num_threads);

/// Replaces the lower triangle L by that of (L L')^-1.
void InvertFactorInPlace(Eigen::MatrixXd* l, int num_threads);

}  // namespace videogrammetry
