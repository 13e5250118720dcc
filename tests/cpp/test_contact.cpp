#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "interface/contact.hpp"
#include "law_sample.hpp"

namespace latin::interface {

TEST(ContactLaw, IsComplementary) {
  const auto law = make_law("contact");
  law->set("gap", ParameterField((Matrix(2, 1) << 0.05, -0.1).finished()));
  for (const double compliance : {0.0, 0.7}) {
    law->set("compliance", ParameterField(compliance));
    const Asked asked;
    const Matrix force = asked.resolve(*law);
    for (int column = 0; column < 2; ++column) {
      for (int point = 0; point < 2; ++point) {
        const int row = 2 * point;
        const double gap = point == 0 ? 0.05 : -0.1;
        const double open =
            asked.jump(row, column) - asked.flexibility(row) * force(row, column) + gap;
        const double slack = open - compliance * force(row, column);
        EXPECT_LE(force(row, column), 0.0);
        EXPECT_GE(slack, -1e-14);
        EXPECT_NEAR(force(row, column) * slack, 0.0, 1e-14);
        EXPECT_EQ(force(row + 1, column), 0.0);
      }
    }
  }
}

}  // namespace latin::interface
