#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <utility>
#include <vector>

#include "algebra/general_factor.hpp"
#include "latin/common/error.hpp"

namespace {

using latin::Index;
using latin::Matrix;

/// Dense diagonal blocks of a size, each coupled with the next one in a few entries, and without symmetry.
latin::SparseColumns blocks(int count, int size) {
  std::vector<Eigen::Triplet<double, int>> entries;
  for (int b = 0; b < count; ++b) {
    for (int i = 0; i < size; ++i) {
      for (int j = 0; j < size; ++j) {
        const double value = std::sin(1.0 + i + 2.0 * j + b) + (i == j ? 3.0 * size : 0.0);
        entries.emplace_back(b * size + i, b * size + j, value);
      }
    }
    if (b > 0) {
      entries.emplace_back(b * size, (b - 1) * size + 1, 2.0);
      entries.emplace_back((b - 1) * size + 2, b * size, -5.0);
    }
  }
  latin::SparseColumns matrix(static_cast<Index>(count) * size, static_cast<Index>(count) * size);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

TEST(GeneralFactor, SolvesWithoutSymmetry) {
  const latin::SparseColumns matrix = blocks(6, 20);
  const Matrix exact = Matrix::Random(matrix.rows(), 3);
  latin::algebra::GeneralFactor made(matrix);
  const latin::algebra::GeneralFactor factor = std::move(made);
  EXPECT_LT((factor.solve(matrix * exact) - exact).norm(), 1e-12 * exact.norm());
}

TEST(GeneralFactor, RefusesASingularMatrix) {
  latin::SparseColumns matrix = blocks(2, 5);
  matrix.prune([](Index row, Index, double) { return row != 3; });
  EXPECT_THROW(latin::algebra::GeneralFactor{matrix}, latin::NumericalError);
}

}  // namespace
