#pragma once

#include "latin/common/types.hpp"

namespace latin {

/// Memory of a working block that many shapes share: it grows to the largest and is kept.
class Workspace {
 public:
  /// The block, not initialised; it is valid until the next call.
  [[nodiscard]] Eigen::Map<Matrix> shaped(Index rows, Index columns) {
    if (store_.size() < rows * columns) {
      store_.resize(rows * columns);
    }
    return {store_.data(), rows, columns};
  }

 private:
  Vector store_;
};

}  // namespace latin
