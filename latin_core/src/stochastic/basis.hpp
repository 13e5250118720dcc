#pragma once

#include <vector>

#include "stochastic/germ.hpp"
#include "stochastic/multi_index.hpp"

namespace latin::stochastic {

/// Orthonormal polynomial chaos: Psi_i(xi) = prod_l psi^(l)_{i_l}(xi_l), i in an index set, E[Psi_i
/// Psi_j] = delta_ij (paper, equation 12, with normalised polynomials; P + 1 = size()).
class ChaosBasis {
 public:
  /// @throws InputError if the numbers of germs and variables differ, or a germ has no polynomial
  /// of a
  ///         degree that the set asks for
  ChaosBasis(std::vector<Germ> germs, MultiIndexSet indices);

  [[nodiscard]] Index size() const { return indices_.size(); }
  [[nodiscard]] Index dimension() const { return indices_.dimension(); }
  [[nodiscard]] const std::vector<Germ>& germs() const { return germs_; }
  [[nodiscard]] const MultiIndexSet& indices() const { return indices_; }
  /// Recurrence of one germ, one coefficient longer than its greatest degree where it has one.
  [[nodiscard]] const Recurrence& recurrence(Index germ) const {
    return recurrences_[static_cast<std::size_t>(germ)];
  }

  /// All modes at `points` (N, L): (N, size()).
  [[nodiscard]] Matrix evaluate(ConstMatrixRef points) const;

  /// Fields from their coefficients (rows, size()) at `points` (N, L): (rows, N).
  [[nodiscard]] Matrix evaluate(ConstMatrixRef coefficients, ConstMatrixRef points) const;

 private:
  std::vector<Germ> germs_;
  MultiIndexSet indices_;
  std::vector<Recurrence> recurrences_;
};

}  // namespace latin::stochastic
