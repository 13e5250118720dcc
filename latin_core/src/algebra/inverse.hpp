#pragma once

#include "latin/common/types.hpp"

namespace latin::algebra {

/// The inverse of a symmetric positive definite matrix A = L L^T, a third of the work of solving with the identity.
/// @param lower L, of which the lower triangle is read
/// @return both triangles
[[nodiscard]] Matrix inverse_of_factored(Matrix lower);

}  // namespace latin::algebra
