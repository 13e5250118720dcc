#pragma once

#include <vector>

#include "stochastic/germ.hpp"

namespace latin::stochastic {

/// Product of Gauss rules with counts[l] points in germ l; the last germ varies fastest.
/// @throws InputError if a count is < 1, or the points would take more than memory_limit bytes (0:
/// none)
[[nodiscard]] Rule tensor_gauss(const std::vector<Germ>& germs, const std::vector<Index>& counts,
                                double memory_limit);

/// Smolyak's sparse rule from Gauss rules of 1, 2, ..., level + 1 points: exact for total degree
/// 2 level + 1. Coinciding points are merged; some weights are negative.
/// Source: E. Novak, K. Ritter, Numer. Math. 75 (1996), combination formula.
/// @throws InputError if level < 0, or the points would take more than memory_limit bytes (0: none)
[[nodiscard]] Rule smolyak(const std::vector<Germ>& germs, Index level, double memory_limit);

}  // namespace latin::stochastic
