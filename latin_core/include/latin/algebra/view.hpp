#pragma once

#include <petscmat.h>

#include <memory>
#include <string_view>

#include "latin/common/sparse_view.hpp"
#include "latin/common/types.hpp"

namespace latin::algebra {

/// A square sequential AIJ matrix where it lies in PETSc's memory, with its explicit zeros; it is kept alive
/// with the view and must not change. Other formats are copied.
/// @throws InputError as to_sparse()
std::shared_ptr<const SparseView> view_sparse(Mat matrix, std::string_view name);

/// Copy of a sequential AIJ (or BAIJ) matrix of shape (rows, cols); explicit zeros are dropped because
/// they cost fill in a factorisation.
/// @throws InputError if the matrix is not sequential, or holds a NaN or infinity; `name` is named.
SparseRows to_sparse(Mat matrix, std::string_view name);

}  // namespace latin::algebra
