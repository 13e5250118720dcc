#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "latin/algebra/block_lu.hpp"
#include "latin/common/error.hpp"

using namespace latin;

namespace {

/// A ring of four dense blocks, each coupled with the next by two rows and three columns, unsymmetrically.
Matrix ring(const std::vector<Index>& first) {
  const Index n = first.back();
  Matrix matrix = Matrix::Zero(n, n);
  double value = 0.0;
  const auto next = [&value] { return std::sin(value += 1.7); };
  for (std::size_t b = 0; b + 1 < first.size(); ++b) {
    for (Index i = first[b]; i < first[b + 1]; ++i) {
      for (Index j = first[b]; j < first[b + 1]; ++j) {
        matrix(i, j) = next() + (i == j ? 8.0 : 0.0);
      }
    }
    const std::size_t other = (b + 1) % (first.size() - 1);
    for (Index i = 0; i < 2; ++i) {
      for (Index j = 0; j < 3; ++j) {
        matrix(first[b] + i, first[other] + j) = next();
        matrix(first[other] + j, first[b] + i) = next();
      }
    }
  }
  return matrix;
}

}  // namespace

TEST(BlockLu, SolvesWhatADenseFactorisationSolves) {
  const std::vector<Index> first{0, 5, 5, 12, 16, 25};  // one of the blocks is empty
  const std::vector<Index> full{0, 5, 12, 16, 25};
  const Matrix matrix = ring(full);
  const SparseColumns sparse = matrix.sparseView();
  Matrix load(25, 2);
  for (Index i = 0; i < 25; ++i) {
    load.row(i) << std::cos(static_cast<double>(i)), 1.0;
  }
  const Matrix exact = matrix.partialPivLu().solve(load);
  EXPECT_LE((algebra::BlockLu(sparse, first).solve(load) - exact).norm(), 1e-13 * exact.norm());
}

TEST(BlockLu, RefusesABlockThatIsSingular) {
  const Matrix matrix = Matrix::Zero(4, 4);
  EXPECT_THROW(algebra::BlockLu(SparseColumns(matrix.sparseView()), {0, 2, 4}), NumericalError);
}
