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

/// A y of A = S W, symmetric but for weights of the columns, on several threads: their number changes no bit.
///
/// The time is that of reading A: what is below the diagonal is read once for both sides of it.
/// @param matrix  (n, n) A, read below the diagonal and in square blocks along it
/// @param weights (n) W, none of them zero
[[nodiscard]] Vector product_with_triangle(ConstMatrixRef matrix, ConstVectorRef weights,
                                           ConstVectorRef y);

}  // namespace latin::algebra
