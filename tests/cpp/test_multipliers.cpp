#include "latin/iteration/multipliers.hpp"

#include <gtest/gtest.h>

#include "pushed.hpp"

namespace latin::iteration {
namespace {

constexpr Index many = 500;

TEST(Multipliers, APartInFlightLandsInOneRound) {
  for (const double gap : {0.0, 1.0, 100.0, 1e4}) {
    const chain::Pushed scene{.gap = gap};
    const substructure::Laws laws = scene.build();
    chain::Evaluated at(laws, Matrix::Ones(1, 1));
    ASSERT_TRUE(Multipliers::suits(laws));
    Multipliers multipliers(laws);
    ASSERT_TRUE(multipliers.solve(at.state, many)) << gap;
    const double size = scene.exact().norm();
    EXPECT_LT((at.state.traces.col(0) - scene.exact()).norm(), 1e-9 * size) << gap;
    EXPECT_LT((multipliers.before_last().traces.col(0) - scene.exact()).norm(), 1e-9 * size) << gap;
    // its data are those of the traces: both stages agree
    at.evaluate();
    EXPECT_LT(at.norm(), 1e-9 * metric_of(laws.structure()).norm(at.state.data)) << gap;
  }
}

TEST(Multipliers, WhatNothingHoldsIsNotFound) {
  const substructure::Laws laws = chain::Pushed{.force = 1.0}.build();  // pulled, not pushed
  chain::Evaluated at(laws, Matrix::Ones(1, 1));
  EXPECT_FALSE(Multipliers(laws).solve(at.state, many));
}

TEST(Multipliers, WhatTouchesNothingAndBearsNothingHasNoPlaceOfItsOwn) {
  for (const double force : {0.0, -2.0}) {
    const substructure::Laws laws = chain::Pushed{.force = force, .gap = 1.0}.build();
    chain::Evaluated at(laws, Matrix::Ones(1, 1));
    Multipliers multipliers(laws);
    ASSERT_TRUE(multipliers.solve(at.state, many)) << force;
    // the spring of the first bar, without force as well, gives it its place
    EXPECT_EQ(multipliers.placeless(), (Matrix(1, 3) << 0.0, force == 0.0, 0.0).finished());
  }
}

TEST(Multipliers, FrictionHoldsItsBoundOrSticks) {
  const chain::Sliding scene{.count = 2};
  const substructure::Laws laws = scene.build();
  const double pressed = 1.0;
  for (const double pushed : {0.1, 5.0}) {
    chain::Evaluated at(laws, (Matrix(2, 1) << pressed, pushed).finished());
    ASSERT_TRUE(Multipliers(laws).solve(at.state, many)) << pushed;
    at.evaluate();
    EXPECT_LT(at.norm(), 1e-8);
    // block and spring carry a part of the pressing, the floor the rest
    const Index normal = laws.structure().interface(0).rows[0];
    const Vector force =
        at.state.data.col(0) - laws.structure().directions().cwiseProduct(at.state.traces.col(0));
    const double bound = scene.friction * std::abs(force(normal));
    const double slip = at.state.traces(normal + 1, 0);
    if (pushed < 1.0) {
      EXPECT_LT(std::abs(slip), 1e-9);
      EXPECT_LE(std::abs(force(normal + 1)), bound);
    } else {
      EXPECT_NEAR(std::abs(force(normal + 1)), bound, 1e-8);
      EXPECT_NEAR(slip, scene.compliance() * (pushed - bound), 1e-7);
    }
  }
}

TEST(Multipliers, AHistoryIsFollowedStepByStep) {
  // pushed forth and back: what sticks at the end remembers how far it has slipped
  const chain::Sliding scene;
  const substructure::Laws laws = scene.build().with_steps(3);
  const Matrix loads = (Matrix(2, 3) << 1.0, 1.0, 1.0, 5.0, 4.8, 5.0).finished();
  chain::Evaluated at(laws, loads);
  ASSERT_TRUE(Multipliers(laws).solve(at.state, many));
  at.evaluate();
  EXPECT_LT(at.norm(), 1e-8);
  const Index tangential = laws.structure().interface(0).rows[0] + 1;
  EXPECT_GT(at.state.traces(tangential, 0), 1.0);
  EXPECT_NEAR(at.state.traces(tangential, 1), at.state.traces(tangential, 0), 1e-8);
  EXPECT_NEAR(at.state.traces(tangential, 2), at.state.traces(tangential, 0), 1e-7);
}

TEST(Multipliers, FewFactorisationsAreNotExceeded) {
  const substructure::Laws laws = chain::Sliding{.count = 2}.build();
  chain::Evaluated at(laws, (Matrix(2, 1) << 1.0, 5.0).finished());
  EXPECT_FALSE(Multipliers(laws).solve(at.state, 1));
  EXPECT_TRUE(at.state.data.allFinite());
}

}  // namespace
}  // namespace latin::iteration
