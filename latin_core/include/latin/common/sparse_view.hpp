#pragma once

#include <memory>

#include "latin/common/types.hpp"

namespace latin {

/// A sparse matrix that is stored elsewhere.
using SparseView = Eigen::Map<const SparseRows>;

/// @param matrix compressed; must outlive the view
inline SparseView view_of(const SparseRows& matrix) {
  return {matrix.rows(),          matrix.cols(),          matrix.nonZeros(),
          matrix.outerIndexPtr(), matrix.innerIndexPtr(), matrix.valuePtr()};
}

/// A view that keeps its matrix.
inline std::shared_ptr<const SparseView> owning_view(SparseRows matrix) {
  // Eigen's sparse matrices swap, they do not move
  struct Owner {
    explicit Owner(SparseRows& given) : matrix(taken(given)), view(view_of(matrix)) {}
    static SparseRows taken(SparseRows& given) {
      SparseRows matrix;
      matrix.swap(given);
      return matrix;
    }
    SparseRows matrix;
    SparseView view;
  };
  const auto owner = std::make_shared<const Owner>(matrix);
  return {owner, &owner->view};
}

}  // namespace latin
