#include "algebra/inverse.hpp"

#include "algebra/lapack.hpp"

namespace latin::algebra {

Matrix inverse_of_factored(Matrix lower) {
  const int n = static_cast<int>(lower.rows());
  if (n == 0) {
    return lower;
  }
  int info = 0;  // positive where a pivot is zero, which no factor has
  dpotri_("L", &n, lower.data(), &n, &info);
  return Matrix(lower.selfadjointView<Eigen::Lower>());
}

}  // namespace latin::algebra
