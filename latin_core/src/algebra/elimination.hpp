#pragma once

#include <memory>
#include <string>
#include <utility>

#include "algebra/factor.hpp"
#include "latin/common/types.hpp"

namespace latin::algebra {

/// A symmetric matrix of which all but the last unknowns are eliminated: A_ii of the others must be definite.
class Elimination {
 public:
  /// @param lower lower triangle, as for factorise()
  /// @param kept  number of last unknowns
  /// @param name  named in error messages
  /// @throws NumericalError if A_ii is not positive definite, or memory runs out
  Elimination(const SparseRows& lower, Index kept, FactorBackend backend, const std::string& name);

  [[nodiscard]] Index size() const { return size_; }
  [[nodiscard]] Index kept() const { return kept_; }
  /// Numbers stored in the factor.
  [[nodiscard]] double nonzeros() const { return interior_ ? interior_->nonzeros() : 0.0; }
  /// S = A_kk - A_ki A_ii^-1 A_ik, (kept, kept), lower triangle. It is let go.
  [[nodiscard]] Matrix take_schur() { return std::move(schur_); }
  /// Forces (size, c) as those on the kept unknowns alone: f_k - A_ki A_ii^-1 f_i, (kept, c).
  /// @param partial what expand() goes on from, (size, c)
  [[nodiscard]] Matrix reduce(ConstMatrixRef forces, Matrix& partial) const;
  /// Displacements (size, c) under these forces, where the kept unknowns move by `kept`, (kept, c).
  [[nodiscard]] Matrix expand(ConstMatrixRef kept, Matrix partial) const;

 private:
  Index size_;
  Index kept_;
  bool condenses_ = false;  ///< else the factor is that of A_ii, and A_ki is kept beside it
  std::unique_ptr<Factor> interior_;  ///< null: nothing is eliminated
  SparseRows coupling_;
  Matrix schur_;
};

}  // namespace latin::algebra
