#pragma once

#include "latin/common/types.hpp"

namespace latin::algebra {

/// Of no more columns the time is that of reading a factor, which BLAS reads more often than once, or copies first: here
/// a piece of it is taken for all columns while it is in the cache. More of them are left to BLAS.
constexpr Index few_columns = 3;

/// x <- L1^-1 x above, and x - L2 L1^-1 x below, column by column of x.
/// @param lower (n, m) of a lower triangle L1 and L2 below it
/// @param x     (n, c), columns without gaps
void solve_with_trapezoid(ConstMatrixRef lower, MatrixRef x);

/// x <- L1^-T (x - L2^T y) above, and y below as it is, likewise.
void solve_with_transposed_trapezoid(ConstMatrixRef lower, MatrixRef x);

/// x <- (L L^T)^-1 x of a dense lower triangle L.
/// @param lower (n, n), of which the lower triangle is read
/// @param x     (n, c), columns without gaps
void solve_with_triangle(ConstMatrixRef lower, MatrixRef x);

}  // namespace latin::algebra
