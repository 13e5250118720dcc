#include <gtest/gtest.h>

#include "iteration/safeguard.hpp"

using latin::Index;
using latin::Matrix;
using latin::iteration::Safeguard;
using latin::iteration::State;

namespace {

/// A run of which only the residual norm is looked at; the data say from which iteration an iterate is.
struct Guarded {
  Safeguard safeguard;
  State state{Matrix::Zero(1, 1), Matrix::Zero(1, 1)};
  Matrix residual = Matrix::Zero(1, 1);

  bool guard(Index iteration, double norm, double rounding = 0.0) {
    set(iteration, norm);
    return safeguard.guard(iteration, norm, rounding, {state, residual});
  }
  void set(Index iteration, double norm) {
    state.data(0, 0) = static_cast<double>(iteration);
    state.traces(0, 0) = -static_cast<double>(iteration);
    residual(0, 0) = norm;
  }
  /// Plain steps until the next accelerated one.
  Index pause() {
    Index steps = 0;
    for (; safeguard.plain(); ++steps) {
      safeguard.count_step();
    }
    return steps;
  }
};

}  // namespace

TEST(Safeguard, LetsAFallingResidualAlone) {
  Guarded run;
  for (Index i = 0; i < 100; ++i) {
    EXPECT_FALSE(run.guard(i, 1.0 / static_cast<double>(i + 1)));
    EXPECT_EQ(run.state.data(0, 0), static_cast<double>(i));
    EXPECT_FALSE(run.safeguard.plain());
  }
  EXPECT_EQ(run.safeguard.restarts(), 0);
  EXPECT_EQ(run.safeguard.best_norm(), 0.01);
}

TEST(Safeguard, TakesTheBestIterateUpAgainWhenLedAstray) {
  Guarded run;
  EXPECT_FALSE(run.guard(0, 2.0));
  EXPECT_FALSE(run.guard(1, 1.0));
  EXPECT_FALSE(run.guard(2, 9.0));  // not yet
  EXPECT_TRUE(run.guard(3, 11.0));
  EXPECT_EQ(run.state.data(0, 0), 1.0);
  EXPECT_EQ(run.state.traces(0, 0), -1.0);
  EXPECT_EQ(run.residual(0, 0), 1.0);
  EXPECT_EQ(run.safeguard.restarts(), 1);
  EXPECT_EQ(run.pause(), 4);
}

TEST(Safeguard, TakesTheBestIterateUpAgainWhenGoingInCircles) {
  Guarded run;
  EXPECT_FALSE(run.guard(0, 1.0));
  Index i = 1;
  while (!run.guard(i, 1.5)) {
    ++i;
  }
  EXPECT_EQ(i, 16);
  EXPECT_EQ(run.state.data(0, 0), 0.0);
}

TEST(Safeguard, DoesNotCallPlainStepsCircling) {
  Guarded run;
  EXPECT_FALSE(run.guard(0, 1.0));
  run.safeguard.pause(100);
  for (Index i = 1; i < 50; ++i) {
    EXPECT_FALSE(run.guard(i, 1.5));
  }
}

TEST(Safeguard, LeavesATrapTheSecondTime) {
  Guarded run;
  EXPECT_FALSE(run.guard(0, 1.0));
  EXPECT_TRUE(run.guard(1, 20.0));
  EXPECT_EQ(run.pause(), 4);
  EXPECT_TRUE(run.guard(6, 20.0));  // the plain steps led back here
  EXPECT_EQ(run.state.data(0, 0), 6.0);
  EXPECT_EQ(run.safeguard.best_norm(), 20.0);
  EXPECT_EQ(run.pause(), 8);
  EXPECT_FALSE(run.guard(7, 19.0));
}

TEST(Safeguard, TakesMorePlainStepsEachTime) {
  Guarded run;
  EXPECT_FALSE(run.guard(0, 1.0));
  std::vector<Index> pauses;
  for (Index i = 1; i <= 7; ++i) {
    // a better iterate in between: none of them is a trap
    const double best = std::pow(0.5, static_cast<double>(i));
    EXPECT_FALSE(run.guard(2 * i, best));
    EXPECT_TRUE(run.guard(2 * i + 1, 20.0 * best));
    pauses.push_back(run.pause());
  }
  EXPECT_EQ(pauses, (std::vector<Index>{4, 8, 16, 32, 64, 64, 64}));
}

TEST(Safeguard, LeavesAnIterateAtRest) {
  Guarded run;
  EXPECT_FALSE(run.guard(0, 1e-20, 1e-15));
  EXPECT_FALSE(run.guard(1, 1e-16, 1e-15));
  EXPECT_TRUE(run.guard(2, 1e-14, 1e-15));
}

TEST(Safeguard, AfterAJumpComparesWithNothingBefore) {
  Guarded run;
  EXPECT_FALSE(run.guard(0, 1.0));
  run.safeguard.pause(3);
  run.set(1, 50.0);
  run.safeguard.jumped(1, 50.0, {run.state, run.residual});
  EXPECT_FALSE(run.safeguard.plain());
  EXPECT_EQ(run.safeguard.best_norm(), 50.0);
  EXPECT_FALSE(run.guard(2, 200.0));
  EXPECT_TRUE(run.guard(3, 600.0));
  EXPECT_EQ(run.state.data(0, 0), 1.0);
}

TEST(Safeguard, ForgetsNormsThatWereRoundedOff) {
  Guarded run;
  EXPECT_FALSE(run.guard(0, 1e-9));
  run.safeguard.forget();
  EXPECT_FALSE(run.guard(1, 1.0));
  EXPECT_EQ(run.safeguard.best_norm(), 1.0);
}
