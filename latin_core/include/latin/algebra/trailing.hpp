#pragma once

#include <memory>

#include "latin/algebra/factor.hpp"

namespace latin::algebra {

/// A matrix that differs from a factorised one in its trailing block only: the sparse factor stays, the dense one of
/// the Schur complement is made anew. A solution costs two of the first.
///
/// With S the Schur complement of the first matrix and S + D that of the changed one,
///
///     x = y + A^-1 [0; S (x_t - y_t)],   A y = b,   (S + D) x_t = S y_t,
///
/// where S y_t is what b leaves on the trailing unknowns.
class ChangedTrailing final : public Factor {
 public:
  /// @param first    factor of the first matrix, which condenses
  /// @param trailing its trailing factor
  /// @param change   D, lower triangle
  /// @param name     named in error messages
  /// @throws NumericalError if the changed matrix is not positive definite
  ChangedTrailing(std::shared_ptr<const Factor> first, Matrix trailing, const SparseRows& change,
                  const std::string& name);

  [[nodiscard]] Index size() const override { return first_->size(); }
  [[nodiscard]] Matrix solve(ConstMatrixRef rhs) const override;
  [[nodiscard]] Matrix trailing_factor() const override { return changed_; }
  [[nodiscard]] bool condenses() const override { return true; }
  [[nodiscard]] double nonzeros() const override { return first_->nonzeros(); }
  [[nodiscard]] double least_pivot() const override { return first_->least_pivot(); }
  [[nodiscard]] std::string backend() const override { return first_->backend(); }

 private:
  std::shared_ptr<const Factor> first_;
  Matrix trailing_;
  Matrix changed_;
};

}  // namespace latin::algebra
