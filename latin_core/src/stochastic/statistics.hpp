#pragma once

#include <vector>

#include "stochastic/multi_index.hpp"

namespace latin::stochastic {

// Answers from the coefficients (rows, modes) of fields in an orthonormal chaos. Everything is per
// row;
// @throws InputError if the number of columns is not the number of modes.
// Source of the indices: B. Sudret, Reliab. Eng. Syst. Saf. 93 (2008) 964.

/// (rows) variance, unit squared.
[[nodiscard]] Vector variance(ConstMatrixRef coefficients);

/// (rows) part of the variance due to the variables in `group` and their interactions among each
/// other; NaN in a row without variance.
[[nodiscard]] Vector sobol_closed(ConstMatrixRef coefficients, const MultiIndexSet& indices,
                                  const std::vector<Index>& group);

}  // namespace latin::stochastic
