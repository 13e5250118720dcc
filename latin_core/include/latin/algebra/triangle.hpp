#pragma once

#include "latin/common/types.hpp"

namespace latin::algebra {

/// x <- (L L^T)^-1 x of a dense lower triangle L, column by column of x.
///
/// Of few columns the time is that of reading L, which BLAS reads more often than once: here a piece of L is taken for all
/// columns while it is in the cache. From four columns on it is left to BLAS.
/// @param lower (n, n), of which the lower triangle is read
/// @param x     (n, c), columns without gaps
void solve_with_triangle(ConstMatrixRef lower, MatrixRef x);

}  // namespace latin::algebra
