#pragma once

#include <memory>

#include "algebra/factor.hpp"

namespace latin::algebra {

/// A matrix that differs from a factorised one in its trailing block only: the sparse factor stays, the dense one of
/// the Schur complement is made anew: of L = [L_11, 0; L_21, L_22] only L_22 changes.
class ChangedTrailing final : public Factor {
 public:
  /// @param first  factor of the first matrix, which condenses
  /// @param change D, lower triangle
  /// @param name   named in error messages
  /// @throws NumericalError if the changed matrix is not positive definite
  ChangedTrailing(std::shared_ptr<const Factor> first, const SparseRows& change,
                  const std::string& name);

  [[nodiscard]] Index size() const override { return first_->size(); }
  [[nodiscard]] Matrix solve(ConstMatrixRef rhs) const override { return backward(forward(rhs)); }
  [[nodiscard]] Matrix forward(ConstMatrixRef rhs) const override;
  [[nodiscard]] Matrix backward(ConstMatrixRef rhs) const override;
  [[nodiscard]] MatrixView trailing_factor() const override {
    return {changed_.data(), changed_.rows(), changed_.cols(),
            Eigen::OuterStride<>(changed_.rows())};
  }
  [[nodiscard]] bool condenses() const override { return true; }
  [[nodiscard]] double nonzeros() const override { return first_->nonzeros(); }
  [[nodiscard]] double least_pivot() const override { return first_->least_pivot(); }
  [[nodiscard]] std::string backend() const override { return first_->backend(); }

 private:
  std::shared_ptr<const Factor> first_;
  Matrix changed_;
};

}  // namespace latin::algebra
