#pragma once

#include <vector>

#include "latin/stochastic/multi_index.hpp"

namespace latin::stochastic {

// Answers from the coefficients (rows, modes) of fields in an orthonormal chaos. Everything is per
// row;
// @throws InputError if the number of columns is not the number of modes.
// Source of the indices: B. Sudret, Reliab. Eng. Syst. Saf. 93 (2008) 964.

/// (rows) expectation.
[[nodiscard]] Vector mean(ConstMatrixRef coefficients);

/// (rows) variance, unit squared.
[[nodiscard]] Vector variance(ConstMatrixRef coefficients);

/// (rows, max degree + 1) share of each total degree in the variance, unit squared; column 0 is 0.
/// Its decay tells whether the order suffices.
[[nodiscard]] Matrix variance_by_degree(ConstMatrixRef coefficients, const MultiIndexSet& indices);

/// (rows, L) part of the variance due to each variable alone; NaN in a row without variance.
[[nodiscard]] Matrix sobol_first(ConstMatrixRef coefficients, const MultiIndexSet& indices);

/// (rows, L) part of the variance in which each variable takes part; NaN in a row without variance.
[[nodiscard]] Matrix sobol_total(ConstMatrixRef coefficients, const MultiIndexSet& indices);

/// (rows) part of the variance due to the variables in `group` and their interactions among each
/// other; NaN in a row without variance.
[[nodiscard]] Vector sobol_closed(ConstMatrixRef coefficients, const MultiIndexSet& indices,
                                  const std::vector<Index>& group);

}  // namespace latin::stochastic
