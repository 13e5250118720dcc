#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "interface/elastic.hpp"
#include "law_sample.hpp"

namespace latin::interface {

TEST(ElasticLaw, SatisfiesItsEquationOnTheResolvent) {
  const auto law = make_law("elastic");
  law->set("normal", ParameterField((Matrix(2, 1) << 3.0, 0.0).finished()));
  law->set("tangential", ParameterField(7.0));
  law->set("jump", ParameterField((Matrix(4, 1) << -0.2, 0.0, 0.1, 0.0).finished()));
  const Asked asked;
  const Matrix force = asked.resolve(*law);
  const Vector kappa = (Vector(4) << 3.0, 7.0, 0.0, 7.0).finished();
  const Vector imposed = (Vector(4) << -0.2, 0.0, 0.1, 0.0).finished();
  for (int column = 0; column < 2; ++column) {
    for (int row = 0; row < 4; ++row) {
      const double jump = asked.jump(row, column) - asked.flexibility(row) * force(row, column);
      EXPECT_NEAR(force(row, column), kappa(row) * (jump - imposed(row)), 1e-14);
    }
  }
}

TEST(ElasticLaw, ReachesThePerfectLawAtInfinity) {
  const auto elastic = make_law("elastic");
  const auto perfect = make_law("perfect");
  const Asked asked;
  for (const double stiffness : {1e16, 1e300, infinity}) {
    elastic->set("normal", ParameterField(stiffness));
    elastic->set("tangential", ParameterField(stiffness));
    EXPECT_LT((asked.resolve(*elastic) - asked.resolve(*perfect)).norm(), 1e-14);
  }
}

TEST(ElasticLaw, VanishesWithoutStiffness) {
  const auto law = make_law("elastic");
  EXPECT_EQ(Asked{}.resolve(*law).norm(), 0.0);
}

}  // namespace latin::interface
