#pragma once

#include "latin/common/types.hpp"

namespace latin {

/// Memory of a working block that many shapes share: it grows to the largest and is kept. One object serves
/// one thread.
template <class Number>
class WorkspaceOf {
 public:
  using Block = Eigen::Matrix<Number, Eigen::Dynamic, Eigen::Dynamic>;

  /// The block, not initialised; it is valid until the next call.
  [[nodiscard]] Eigen::Map<Block> shaped(Index rows, Index columns) {
    if (store_.size() < rows * columns) {
      store_.resize(rows * columns);
    }
    return {store_.data(), rows, columns};
  }

 private:
  Eigen::Matrix<Number, Eigen::Dynamic, 1> store_;
};

using Workspace = WorkspaceOf<double>;

}  // namespace latin
