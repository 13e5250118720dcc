#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "interface/force.hpp"
#include "law_sample.hpp"

namespace latin::interface {

TEST(ForceLaw, IgnoresTheJump) {
  const auto law = make_law("force");
  law->set("force", ParameterField((Matrix(4, 1) << 1.0, 2.0, 3.0, 4.0).finished()));
  const Matrix force = Asked{}.resolve(*law);
  EXPECT_EQ(force.col(0), force.col(1));
  EXPECT_EQ(force(2, 1), 3.0);
}

}  // namespace latin::interface
