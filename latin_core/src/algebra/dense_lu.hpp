#pragma once

#include <vector>

#include "latin/common/types.hpp"

namespace latin::algebra {

/// LU factors of a square dense matrix with row pivots, P A = L U, made and used on several threads: their number changes
/// no bit.
class DenseLU {
 public:
  /// Room for the matrix A (size, size), whose numbers are to be set before factorise(); what was there is gone. Memory
  /// is kept from one matrix to the next.
  [[nodiscard]] Eigen::Map<Matrix> matrix(Index size);
  /// Of the numbers in matrix(). Nothing is checked: answers of a singular matrix are not finite.
  void factorise();
  /// x of A^T x = right.
  [[nodiscard]] Vector solve_transposed(ConstVectorRef right) const;

  [[nodiscard]] Index size() const { return size_; }

 private:
  [[nodiscard]] Eigen::Map<const Matrix> factors() const { return {numbers_.data(), size_, size_}; }
  void factorise_panel(Index first);
  /// Exchange rows of some columns as the pivots of a panel say.
  void exchange(Index panel, Index column, Index columns);
  /// Bring columns right of a panel up to date.
  void update(Index panel, Index column, Index columns);

  Vector numbers_;  ///< L below the diagonal, which is 1, and U; may have room for more
  Index size_ = 0;
  std::vector<int>
      pivots_;  ///< with which row each was exchanged, from that of its panel on, from 1 on
};

}  // namespace latin::algebra
