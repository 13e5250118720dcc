#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "interface/preload.hpp"
#include "law_sample.hpp"

namespace latin::interface {

TEST(PreloadLaw, IsAForceThenALength) {
  const auto law = make_law("preload");
  law->set("force", ParameterField(5.0));
  law->set("locked", ParameterField((Matrix(1, 8) << 0, 0, 1, 1, 1, 0, 1, 1).finished()));
  const Vector c = (Vector(2) << 0.25, 2.0).finished();
  const Matrix free = Matrix::Random(2, 8);
  Matrix force(2, 8);
  law->resolve({2, free, c, 4}, force);
  const Matrix jump = free - c.asDiagonal() * force;
  for (const int step : {0, 1, 5}) {
    EXPECT_EQ(force(0, step), 5.0);
  }
  EXPECT_NEAR(jump(0, 2), jump(0, 1), 1e-15);
  EXPECT_NEAR(jump(0, 3), jump(0, 1), 1e-15);
  EXPECT_NEAR(jump(0, 4), 0.0, 1e-15);  // a history that begins locked keeps its length
  EXPECT_NEAR(jump(0, 6), jump(0, 5), 1e-15);
  EXPECT_LT(jump.row(1).norm(), 1e-15);  // tied
}

}  // namespace latin::interface
