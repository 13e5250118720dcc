#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "latin/interface/coulomb.hpp"
#include "law_sample.hpp"

namespace latin::interface {

TEST(CoulombLaw, SticksSlipsAndRemembers) {
  const auto law = make_law("coulomb");
  law->set("friction", ParameterField(0.3));
  // one point, pressed by -2 in every step, sheared by a cycle; c = 1
  const Matrix jump = (Matrix(2, 5) << -2, -2, -2, -2, -2, 0.5, 1.0, 2.0, 0.0, 1.4).finished();
  Matrix force(2, 5);
  law->resolve({2, jump, Vector::Ones(2), 5}, force);
  double before = 0.0;
  for (int step = 0; step < 5; ++step) {
    const double slipped = jump(1, step) - force(1, step);
    EXPECT_EQ(force(0, step), -2.0);
    EXPECT_LE(std::abs(force(1, step)), 0.6 + 1e-15);
    const double slip = slipped - before;
    // no slip below the bound; at the bound the slip has the direction of the force
    EXPECT_NEAR(slip * (0.6 - std::abs(force(1, step))), 0.0, 1e-14);
    EXPECT_GE(slip * force(1, step), -1e-14);
    before = slipped;
  }
  EXPECT_EQ(force(1, 0), 0.5);   // sticks
  EXPECT_EQ(force(1, 1), 0.6);   // slips
  EXPECT_EQ(force(1, 3), -0.6);  // slips back
  // without history every column is a first step
  law->resolve({2, jump, Vector::Ones(2)}, force);
  EXPECT_EQ(force(1, 3), 0.0);
}

TEST(CoulombLaw, Limits) {
  const auto law = make_law("coulomb");
  const auto contact = make_law("contact");
  const Asked asked;
  EXPECT_EQ((asked.resolve(*law) - asked.resolve(*contact)).norm(), 0.0);  // mu = 0
  law->set("friction", ParameterField(1e12));
  const Matrix stuck = asked.resolve(*law);
  EXPECT_NEAR(stuck(3, 0), asked.jump(3, 0) / 2.0, 1e-12);
  EXPECT_EQ(stuck(1, 0), 0.0);  // open: nothing to rub on
}

}  // namespace latin::interface
