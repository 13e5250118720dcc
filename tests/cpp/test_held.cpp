#include <gtest/gtest.h>

#include "interface/held.hpp"
#include "law_sample.hpp"

namespace latin::interface {

TEST(HeldLaw, RemembersWhereItLetGo) {
  const auto law = make_law("held");
  law->set("held", ParameterField((Matrix(1, 10) << 1, 0, 1, 1, 0, 1, 0, 1, 1, 1).finished()));
  law->set("kept", ParameterField((Matrix(1, 10) << 1, 0, 1, 0.5, 0, 0, 0, 1, 1, 1).finished()));
  law->set("jump", ParameterField((Matrix(2, 1) << 0.25, -0.5).finished()));
  const Vector c = (Vector(2) << 0.25, 2.0).finished();
  const Matrix free = Matrix::Random(2, 10);
  Matrix force(2, 10);
  law->resolve({2, free, c, 5}, force);
  const Vector value = (Vector(2) << 0.25, -0.5).finished();
  const Matrix off = (free - c.asDiagonal() * force).colwise() - value;
  for (const int step : {1, 4, 6}) {
    EXPECT_EQ(force.col(step).norm(), 0.0);
  }
  EXPECT_LT(off.col(0).norm(), 1e-15);  // it has not let go before
  EXPECT_LT((off.col(2) - off.col(1)).norm(), 1e-15);
  EXPECT_LT((off.col(3) - 0.5 * off.col(1)).norm(), 1e-15);
  EXPECT_LT(off.col(5).norm(), 1e-15);  // another history begins
  EXPECT_LT((off.col(9) - off.col(6)).norm(), 1e-15);
}

TEST(HeldLaw, KnowsItsSlopes) {
  const auto law = make_law("held");
  law->set("held", ParameterField((Matrix(1, 2) << 1, 0).finished()));
  const Vector c = (Vector(2) << 0.25, 2.0).finished();
  const Matrix free = Matrix::Random(2, 1);
  const LocalProblem problem{2, free, c};
  Matrix slopes(2, 2);
  ASSERT_TRUE(law->slopes(problem, 0, Matrix::Zero(3, 1), slopes));
  EXPECT_EQ(slopes, Matrix((Matrix(2, 2) << 4.0, 0.0, 0.0, 0.5).finished()));
  ASSERT_TRUE(law->slopes(problem, 1, Matrix::Zero(3, 1), slopes));
  EXPECT_EQ(slopes.norm(), 0.0);
}

}  // namespace latin::interface
