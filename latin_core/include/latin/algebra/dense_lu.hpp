#pragma once

#include <vector>

#include "latin/common/types.hpp"

namespace latin::algebra {

/// LU factors of a square dense matrix with row pivots, P A = L U, made on several threads: their number changes no bit.
class DenseLU {
 public:
  /// Nothing is checked: answers of a singular matrix are not finite.
  void factorise(Matrix matrix);
  /// x of A^T x = right.
  [[nodiscard]] Vector solve_transposed(ConstVectorRef right) const;

  [[nodiscard]] Index size() const { return factors_.rows(); }
  /// The memory of the factors, which are gone.
  [[nodiscard]] Matrix release();

 private:
  void factorise_panel(Index first);
  /// Exchange rows of some columns as the pivots of a panel say.
  void exchange(Index panel, Index column, Index columns);
  /// Bring columns right of a panel up to date.
  void update(Index panel, Index column, Index columns);

  Matrix factors_;  ///< L below the diagonal, which is 1, and U
  std::vector<int>
      pivots_;  ///< with which row each was exchanged, from that of its panel on, from 1 on
};

}  // namespace latin::algebra
