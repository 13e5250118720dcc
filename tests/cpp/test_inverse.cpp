#include <gtest/gtest.h>
#include <Eigen/Cholesky>

#include "algebra/inverse.hpp"

using latin::Index;
using latin::Matrix;

TEST(Inverse, IsThatOfTheFactoredMatrix) {
  for (const Index size : {0, 1, 2, 63, 200}) {
    const Matrix any = Matrix::Random(size, size);
    const Matrix matrix = any * any.transpose() + Matrix::Identity(size, size);
    const Eigen::LLT<Matrix> factor(matrix);  // above the diagonal it has A
    const Matrix inverse = latin::algebra::inverse_of_factored(factor.matrixLLT());
    ASSERT_EQ(inverse.rows(), size);
    EXPECT_LE((matrix * inverse - Matrix::Identity(size, size)).norm(), 1e-11 * (1.0 + size));
    EXPECT_EQ(inverse, inverse.transpose());
  }
}
