#include <gtest/gtest.h>

#include "latin/algebra/triangle.hpp"

using latin::Index;
using latin::Matrix;

TEST(Triangle, SolvesFewAndManyColumnsAlike) {
  // sizes around those of the pieces: 64 columns, 2 048 rows
  for (const Index size : {1, 2, 63, 64, 65, 200, 2300}) {
    Matrix lower = Matrix::Random(size, size) / static_cast<double>(size);
    lower.diagonal().array() = 2.0;
    const Matrix kept = lower;  // what is above the diagonal is not read
    const Matrix clean = lower.triangularView<Eigen::Lower>();
    for (const Index columns : {0, 1, 2, 3, 4, 7}) {
      const Matrix exact = Matrix::Random(size, columns);
      Matrix x = clean * (clean.transpose() * exact);
      latin::algebra::solve_with_triangle(lower, x);
      EXPECT_LE((x - exact).norm(), 1e-13 * exact.norm()) << size << ", " << columns;
    }
    EXPECT_EQ(lower, kept);
  }
  Matrix none(0, 2);
  latin::algebra::solve_with_triangle(Matrix(0, 0), none);
}
