#pragma once

#include "latin/common/types.hpp"

namespace latin::algebra {

/// A symmetric matrix, of which the lower triangle is read, is replaced by its eigenvectors.
/// @return the eigenvalues, ascending; none if LAPACK did not find them
[[nodiscard]] Vector eigenvectors_in_place(Matrix& matrix);

}  // namespace latin::algebra
