#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "interface/coulomb.hpp"
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

TEST(CoulombLaw, ElasticSlip) {
  const auto law = make_law("coulomb");
  law->set("friction", ParameterField(0.3));
  law->set("tangential_compliance", ParameterField(3.0));
  // as above, with c + c_t = 4 of the tangent: loaded, at the bound, back by less than twice the bound, opened, closed
  const Matrix jump = (Matrix(2, 5) << -2, -2, -2, 1, -2, 1.2, 4.0, 2.0, 3.0, 3.2).finished();
  Matrix force(2, 5);
  law->resolve({2, jump, Vector::Ones(2), 5}, force);
  EXPECT_NEAR(force(1, 0), 1.2 / 4.0, 1e-15);
  EXPECT_NEAR(force(1, 1), 0.6, 1e-15);
  EXPECT_NEAR(force(1, 2), 0.6 - 2.0 / 4.0, 1e-15);
  EXPECT_EQ(force(1, 3), 0.0);
  EXPECT_NEAR(force(1, 4), 0.2 / 4.0, 1e-15);  // the elastic slip is forgotten where it opens
}

TEST(CoulombLaw, SlopesAreDerivatives) {
  const Vector flexibility = (Vector(3) << 0.5, 0.7, 0.7).finished();
  for (const double tangential : {0.0, 2.0}) {
    const auto law = make_law("coulomb");
    law->set("compliance", ParameterField(0.1));
    law->set("friction", ParameterField(0.4));
    law->set("threshold", ParameterField(0.1));
    law->set("tangential_compliance", ParameterField(tangential));
    const Matrix before = (Matrix(2, 1) << 0.2, -0.1).finished();
    for (const double sheared : {0.1, 5.0}) {  // sticks, slips
      const Vector jump = (Vector(3) << -1.0, sheared, 0.3 * sheared).finished();
      Matrix slopes(3, 3);
      ASSERT_TRUE(law->slopes({3, jump, flexibility}, 0, before, slopes));
      for (Index component = 0; component < 3; ++component) {
        constexpr double step = 1e-6;
        const auto at = [&](double moved) {
          Vector there = jump;
          there(component) += moved;
          Matrix memory = before;
          Matrix force(3, 1);
          EXPECT_TRUE(law->resolve_column({3, there, flexibility}, 0, memory, force));
          return force;
        };
        const Matrix quotient = (at(step) - at(-step)) / (2.0 * step);
        EXPECT_LT((quotient - slopes.col(component)).norm(), 1e-8) << tangential << " " << sheared;
      }
    }
  }
}

}  // namespace latin::interface
