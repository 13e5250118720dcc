#pragma once

#include <string>
#include <vector>

#include "latin/common/types.hpp"

namespace latin::algebra {

/// out = a x. Eigen takes one column after the other, each sum waiting for its last term; here eight are taken side by
/// side.
void multiply_sparse(const SparseRows& a, const ConstMatrixRef& x, MatrixRef out);

/// The matrix of these entries, those at one place added up.
/// @param what it is, for messages  @throws NumericalError where 32-bit indices cannot count them
[[nodiscard]] SparseRows sparse_of(const Triplets& entries, Index rows, Index columns,
                                   const std::string& what);

/// A compressed matrix as numbers for another rank, behind those that are there.
void append(const SparseRows& matrix, std::vector<double>& numbers);
/// And back. @param next its first number; behind its last one afterwards
[[nodiscard]] SparseRows take(const double*& next);

}  // namespace latin::algebra
