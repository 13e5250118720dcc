#pragma once

#include "latin/common/types.hpp"

namespace latin::algebra {

/// out = a x. Eigen takes one column after the other, each sum waiting for its last term; here eight are taken side by
/// side.
void multiply_sparse(const SparseRows& a, const ConstMatrixRef& x, MatrixRef out);

}  // namespace latin::algebra
