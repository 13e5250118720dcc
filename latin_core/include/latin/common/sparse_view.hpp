#pragma once

#include <memory>
#include <utility>

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
  struct Owner {
    explicit Owner(SparseRows&& given) : matrix(std::move(given)), view(view_of(matrix)) {}
    SparseRows matrix;
    SparseView view;
  };
  const auto owner = std::make_shared<const Owner>(std::move(matrix));
  return {owner, &owner->view};
}

}  // namespace latin
