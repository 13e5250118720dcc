#include <gtest/gtest.h>

#include <limits>

#include "iteration/stopping_rule.hpp"
#include "latin/common/error.hpp"

using latin::Index;
using latin::iteration::Iteration;
using latin::iteration::Options;
using latin::iteration::Status;
using latin::iteration::StoppingRule;

namespace {

constexpr double unknown = std::numeric_limits<double>::infinity();

Options options(Index most = 1000, Index window = 20, bool indicator = false) {
  Options options;
  options.rtol = 1e-3;
  options.stop_on_indicator = indicator;
  options.max_iterations = most;
  options.stagnation_window = window;
  return options;
}

}  // namespace

TEST(StoppingRule, EndsAtTheTolerance) {
  StoppingRule rule(options());
  EXPECT_FALSE(rule.judge({0, unknown, 1e-9, 1.0, 0.0}, {}));
  EXPECT_FALSE(rule.judge({1, 1.1e-3, 1e-9, 0.5, 0.0}, {}));
  EXPECT_EQ(rule.judge({2, 1e-3, 1e-9, 0.2, 0.0}, {}), Status::converged);
}

TEST(StoppingRule, MayLookAtTheIndicatorInstead) {
  StoppingRule rule(options(1000, 20, true));
  EXPECT_FALSE(rule.judge({0, 1e-9, 1.0, 1.0, 0.0}, {}));
  EXPECT_EQ(rule.judge({1, unknown, 1e-3, 0.5, 0.0}, {}), Status::converged);
}

TEST(StoppingRule, EndsAtTheMostIterations) {
  StoppingRule rule(options(3));
  for (Index i = 0; i < 3; ++i) {
    EXPECT_FALSE(rule.judge({i, unknown, 1.0, 1.0, 0.0}, {}));
  }
  EXPECT_EQ(rule.judge({3, unknown, 1.0, 1.0, 0.0}, {}), Status::max_iterations);
}

TEST(StoppingRule, EndsWhenNothingFallsForAWindow) {
  StoppingRule rule(options());
  Index i = 0;
  while (!rule.judge({i, 0.5, 1.0, 1.0 - 1e-4 * static_cast<double>(i), 0.0}, {})) {
    ++i;
  }
  EXPECT_EQ(i, 21);
}

TEST(StoppingRule, ProgressIsAFallOfTheResidualOrOfTheError) {
  for (const bool of_error : {false, true}) {
    StoppingRule rule(options());
    double falling = 1.0;
    for (Index i = 0; i < 200; ++i) {
      falling *= i % 10 == 0 ? 0.89 : 1.0;
      EXPECT_FALSE(
          rule.judge({i, of_error ? falling : 1.0, 1.0, of_error ? 1.0 : falling, 0.0}, {}));
    }
  }
}

TEST(StoppingRule, ForgetsWhatIsNotToBeComparedWith) {
  StoppingRule rule(options());
  EXPECT_FALSE(rule.judge({0, 0.01, 1.0, 1e-9, 0.0}, {}));
  rule.forget();
  EXPECT_FALSE(rule.judge({15, 1.0, 1.0, 1e-6, 0.0}, {}));  // progress again
  EXPECT_FALSE(rule.judge({30, 1.0, 1.0, 1e-6, 0.0}, {}));
  EXPECT_EQ(rule.judge({36, 1.0, 1.0, 1e-6, 0.0}, {}), Status::undecided);
}

TEST(StoppingRule, DoesNotMeasureByAResidualOfNothing) {
  StoppingRule rule(options());
  EXPECT_EQ(rule.judge({0, 0.0, 0.0, 0.0, 0.0}, {}), Status::converged);
  rule.forget();  // the traces were not those of the data
  EXPECT_FALSE(rule.judge({1, 1.0, 1.0, 1.0, 0.0}, {}));
}

TEST(StoppingRule, EndsBeyondAnyUse) {
  for (const double residual : {1.1e10, std::numeric_limits<double>::quiet_NaN(), unknown}) {
    StoppingRule rule(options());
    EXPECT_FALSE(rule.judge({0, unknown, 1.0, 1.0, 0.0}, {}));
    EXPECT_EQ(rule.judge({1, 1e-9, 1.0, residual, 0.0}, {}), Status::undecided);
  }
  EXPECT_EQ(StoppingRule(options()).judge({0, 0.0, 0.0, unknown, 0.0}, {}), Status::undecided);
}

TEST(StoppingRule, AnAnswerCountsMoreThanAnInterruptionAndThatMoreThanTheRest) {
  StoppingRule rule(options(1));
  EXPECT_EQ(rule.judge({5, 1e-9, 1.0, 1.0, 0.0}, Status::interrupted), Status::converged);
  EXPECT_EQ(rule.judge({5, 1.0, 1.0, 1.0, 0.0}, Status::interrupted), Status::interrupted);
  EXPECT_EQ(rule.judge({5, 1.0, 1.0, 1.0, 0.0}, Status::time_limit), Status::time_limit);
  EXPECT_EQ(rule.judge({5, 1.0, 1.0, 1.0, 0.0}, {}), Status::max_iterations);
}

TEST(Options, NameWhatIsOutOfRange) {
  EXPECT_NO_THROW(options().check());
  const auto message = [](auto change) {
    Options wrong = options();
    change(wrong);
    try {
      wrong.check();
    } catch (const latin::InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(message([](Options& o) { o.rtol = 1.0; }), "rtol is 1.000000: it must lie in (0, 1)");
  EXPECT_EQ(message([](Options& o) { o.max_iterations = 0; }),
            "max_iterations is 0: it must be at least 1");
  EXPECT_EQ(message([](Options& o) { o.max_seconds = -1.0; }),
            "max_seconds is -1.000000: it must not be negative");
  EXPECT_EQ(message([](Options& o) { o.acceleration = 101; }),
            "acceleration is 101: it must lie in 0..100");
  EXPECT_EQ(message([](Options& o) { o.relaxation = 0.0; }),
            "relaxation is 0.000000: it must lie in (0, 1]");
}
