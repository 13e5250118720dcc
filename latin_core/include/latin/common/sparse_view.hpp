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

/// A view that keeps a copy of its matrix.
inline std::shared_ptr<const SparseView> owning_view(const SparseRows& matrix) {
  struct Owner {
    explicit Owner(const SparseRows& copied) : matrix(copied), view(view_of(matrix)) {}
    SparseRows matrix;
    SparseView view;
  };
  const auto owner = std::make_shared<const Owner>(matrix);
  return {owner, &owner->view};
}

}  // namespace latin
