#pragma once

#include <Eigen/Cholesky>
#include <memory>
#include <string>

#include "latin/algebra/factor_backend.hpp"
#include "latin/common/types.hpp"

namespace latin::algebra {

/// A pivot of a Cholesky factor below this fraction of its diagonal entry is rounding: an answer would have three digits
/// at most.
inline constexpr double least_relative_pivot = 1e-13;

/// A symmetric positive definite matrix, factorised once.
///
/// With `trailing` > 0 the last `trailing` unknowns are ordered last, and the trailing block of the
/// factor is the Cholesky factor of the Schur complement on them: condensing onto them costs nothing
/// beyond the factorisation.
class Factor {
 public:
  virtual ~Factor() = default;
  Factor() = default;
  Factor(const Factor&) = delete;
  Factor& operator=(const Factor&) = delete;
  Factor(Factor&&) = delete;
  Factor& operator=(Factor&&) = delete;

  [[nodiscard]] virtual Index size() const = 0;
  /// X = A^-1 B for a block of columns at once, shape (size, c).
  [[nodiscard]] virtual Matrix solve(ConstMatrixRef rhs) const = 0;
  /// L^-1 P B and P^T L^-T Z of blocks of columns, (size, c), of a factor that condenses: P A P^T = L L^T, and the
  /// trailing unknowns are the last rows on both sides.
  [[nodiscard]] virtual Matrix forward(ConstMatrixRef rhs) const = 0;
  [[nodiscard]] virtual Matrix backward(ConstMatrixRef rhs) const = 0;
  /// Lower triangle of the (trailing, trailing) factor L of the Schur complement S = L L^T on the trailing
  /// unknowns, in their given order. It is a part of this factor, not a copy: what is above it is no number to use.
  [[nodiscard]] virtual MatrixView trailing_factor() const = 0;
  /// True where trailing_factor() is available.
  [[nodiscard]] virtual bool condenses() const = 0;
  /// Numbers stored in the factor.
  [[nodiscard]] virtual double nonzeros() const = 0;
  /// The smallest pivot, relative to the diagonal entry it is left of: what cancelled in the factorisation. A
  /// rigid motion on soft springs leaves a small one. 1 where the backend does not tell.
  [[nodiscard]] virtual double least_pivot() const { return 1.0; }
  [[nodiscard]] virtual std::string backend() const = 0;
};

/// Factorise the symmetric matrix of which `lower` holds the lower triangle (the columns of a row in any order).
/// @param trailing number of last unknowns to keep last in the elimination order
/// @param name     named in error messages
/// @throws NumericalError if the matrix is not positive definite (with the pivot's position), or memory runs out
std::unique_ptr<Factor> factorise(const SparseRows& lower, Index trailing, FactorBackend backend,
                                  const std::string& name);

/// Whether a dense Cholesky factor is that of a definite matrix by the same measure.
/// @param diagonal of the matrix
template <class Cholesky>
[[nodiscard]] bool is_definite(const Cholesky& factor, ConstVectorRef diagonal) {
  return factor.info() == Eigen::Success &&
         (factor.matrixLLT().diagonal().array().square() >= least_relative_pivot * diagonal.array())
             .all();
}

/// Backends that this build has, the default one first.
std::string available_backends();

}  // namespace latin::algebra
