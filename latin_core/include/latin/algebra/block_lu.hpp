#pragma once

#include <Eigen/LU>
#include <utility>
#include <vector>

#include "latin/common/types.hpp"

namespace latin::algebra {

/// A = L U of a matrix of few dense diagonal blocks that some rows and columns couple, block by block.
///
/// A block with few neighbours is eliminated before one with many. Within a block rows are exchanged, between blocks
/// they are not: every block must be regular when its turn comes.
class BlockLu {
 public:
  /// @param matrix (n, n)
  /// @param first  first rows of the blocks, increasing, from 0 to n
  /// @throws NumericalError a block is singular
  BlockLu(const SparseColumns& matrix, const std::vector<Index>& first);

  /// @param load (n, any)
  [[nodiscard]] Matrix solve(const Matrix& load) const;

 private:
  /// What couples two blocks: its rows and columns that are not zero.
  struct Coupling {
    std::vector<Index> rows;
    std::vector<Index> columns;
    Matrix values;
  };
  /// A block, with what couples it to those after it.
  struct Eliminated {
    Index first;
    Eigen::PartialPivLU<Matrix> lu;
    std::vector<std::pair<Index, Coupling>> down;    ///< (first row of the other, A_other,own)
    std::vector<std::pair<Index, Coupling>> across;  ///< (first column of the other, A_own,other)
  };
  static Coupling coupling(const Matrix& block);

  std::vector<Eliminated> blocks_;
};

}  // namespace latin::algebra
