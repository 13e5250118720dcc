#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "algebra/dense_lu.hpp"
#include "algebra/triangle.hpp"
#include "threads.hpp"

using latin::Index;
using latin::Matrix;
using latin::Vector;

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

TEST(Triangle, MultipliesBothSidesOfTheDiagonal) {
  // sizes around those of the pieces (128 columns, 256 rows), and one that threads share
  for (const Index size : {0, 1, 127, 128, 129, 385, 700}) {
    const Matrix half = Matrix::Random(size, size);
    const Vector weights = Vector::Random(size).array().abs() + 0.5;
    const Matrix matrix = (half + half.transpose()) * weights.asDiagonal();
    const Vector y = Vector::Random(size);
    const auto product = [&](int threads) {
      const Threads some(threads);
      return latin::algebra::product_with_triangle(matrix, weights, y);
    };
    const Vector one = product(1);
    EXPECT_LE((one - matrix * y).norm(), 1e-14 * (matrix.cwiseAbs() * y.cwiseAbs()).norm()) << size;
    EXPECT_EQ(one, product(3)) << size;
  }
}

TEST(DenseLU, SolvesAlikeOnAnyNumberOfThreads) {
  latin::algebra::DenseLU
      lu;  // keeps its memory: sizes rise and fall, around panels (96) and pieces (256)
  for (const Index size : {1, 700, 95, 97, 256, 257, 1100, 0, 513}) {
    // rows of a dominant matrix exchanged in pairs: its condition is small, its pivots are off the diagonal
    Matrix matrix = Matrix::Random(size, size) / std::sqrt(static_cast<double>(size) + 1.0);
    matrix.diagonal().array() += 4.0;
    for (Index row = 0; row + 1 < size; row += 2) {
      matrix.row(row).swap(matrix.row(row + 1));
    }
    const Vector exact = Vector::Random(size);
    const auto solution = [&](int threads) {
      const Threads some(threads);
      lu.matrix(size) = matrix;
      lu.factorise();
      return lu.solve_transposed(matrix.transpose() * exact);
    };
    const Vector one = solution(1);
    EXPECT_LE((one - exact).norm(), 1e-12 * exact.norm()) << size;
    EXPECT_EQ(one, solution(3)) << size;
  }
}
