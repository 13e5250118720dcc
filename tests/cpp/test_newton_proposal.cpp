#include <gtest/gtest.h>

#include <optional>

#include <limits>
#include <tuple>

#include "iteration/newton_proposal.hpp"
#include "latin/common/error.hpp"

using latin::Index;
using latin::Matrix;
using latin::Vector;
using latin::iteration::Metric;
using latin::iteration::NewtonOutcome;
using latin::iteration::NewtonProposal;
using latin::iteration::State;

namespace {

/// An iterate of two columns with residual 1 - s (the answer is 1), and a method that may solve it.
struct Solved {
  Index columns = 2;    ///< that the method solves
  double answer = 1.0;  ///< what it takes for the answer
  int calls = 0;
  State state{Matrix::Zero(3, 2), Matrix::Zero(3, 2)};
  Matrix residual = Matrix::Ones(3, 2);
  NewtonProposal proposal{
      Metric(Vector::Ones(3)),
      [this](State& state, Index) {
        ++calls;
        state.data.leftCols(columns).setConstant(answer);
        state.traces.leftCols(columns).setConstant(-answer);
        return NewtonOutcome{columns, 2.5, 7, 0.0, std::nullopt, Vector(), false};
      },
      [](const State& state, Matrix& residual) { residual = 1.0 - state.data.array(); }};

  NewtonOutcome propose() { return proposal.propose({state, residual}); }
  bool follow() { return proposal.follow(norm(), state.data.norm(), {state, residual}); }
  [[nodiscard]] double norm() const { return residual.norm(); }
  [[nodiscard]] auto left() const { return proposal.left(norm(), state.data.norm()); }
  Index steps_until_due() {
    Index steps = 0;
    for (; !proposal.due(); ++steps) {
      proposal.count_step();
    }
    return steps;
  }
};

}  // namespace

TEST(NewtonProposal, IsNeverDueWhereThereIsNoSuchMethod) {
  NewtonProposal none(Metric(Vector::Ones(3)), {}, {});
  none.begin(true, 10, 100, 1);
  for (int i = 0; i < 100; ++i) {
    EXPECT_FALSE(none.due());
    none.count_step();
  }
  EXPECT_FALSE(none.possible());
}

TEST(NewtonProposal, WaitsLongerFromElsewhereForItCostsMoreThere) {
  Solved from_zero;
  from_zero.proposal.begin(true, 1000, 500, 1);
  EXPECT_EQ(from_zero.steps_until_due(), 0);
  Solved small;
  small.proposal.begin(false, 100, 500, 1);
  EXPECT_EQ(small.steps_until_due(), 50);
  Solved large;  // and the method does not wait for ever
  large.proposal.begin(false, 100000, 5000, 1);
  EXPECT_EQ(large.steps_until_due(), 300);
  Solved few;
  few.proposal.begin(false, 100000, 20, 1);
  EXPECT_EQ(few.steps_until_due(), 10);
}

TEST(NewtonProposal, WaitsAsLongAsAskedButForNoMoreThanHalfOfTheRun) {
  for (const auto& [from_zero, patience, most, wait] : {std::tuple{true, 2, 500, 1},
                                                        {true, 40, 500, 39},
                                                        {true, 4000, 500, 250},
                                                        {true, 40, 1, 0},
                                                        {false, 40, 500, 50},
                                                        {false, 80, 500, 79}}) {
    Solved run;
    run.proposal.begin(from_zero, 100, most, patience);
    EXPECT_EQ(run.proposal.due_within(wait - 1), false);
    EXPECT_EQ(run.proposal.due_within(wait), true);
    EXPECT_EQ(run.steps_until_due(), wait);
  }
  NewtonProposal none(Metric(Vector::Ones(3)), {}, {});
  EXPECT_FALSE(none.due_within(1000));
}

TEST(NewtonProposal, IsUntriedOnce) {
  Solved run;
  run.proposal.begin(false, 1000, 500, 0);
  EXPECT_FALSE(run.proposal.due_within(1'000'000));
  EXPECT_TRUE(run.proposal.untried());
  run.propose();
  EXPECT_FALSE(run.proposal.untried());
  EXPECT_FALSE(NewtonProposal(Metric(Vector::Ones(3)), {}, {}).untried());
}

TEST(NewtonProposal, ProposesAndIsFollowed) {
  Solved run;
  const NewtonOutcome outcome = run.propose();
  EXPECT_EQ(outcome.steps, 7);
  EXPECT_EQ(outcome.stages, 2.5);
  EXPECT_TRUE(run.proposal.made());
  EXPECT_TRUE(run.proposal.whole());
  EXPECT_EQ(run.proposal.step().data, Matrix::Ones(3, 2));
  EXPECT_EQ(run.proposal.residual_norm(), 0.0);
  EXPECT_EQ(run.left(), 0.0);
  EXPECT_TRUE(run.state.data.isZero(0.0));  // until it is followed
  EXPECT_TRUE(run.follow());
  EXPECT_EQ(run.state.data, Matrix::Ones(3, 2));
  EXPECT_EQ(run.state.traces, -Matrix::Ones(3, 2));
  EXPECT_TRUE(run.residual.isZero(0.0));
  EXPECT_FALSE(run.proposal.failed_before());
  run.proposal.withdraw();
  EXPECT_FALSE(run.proposal.made());
  EXPECT_FALSE(run.left().has_value());
}

TEST(NewtonProposal, SaysWhatItLeavesIfThatIsLittle) {
  Solved run;
  run.answer = 0.75;
  run.propose();
  EXPECT_NEAR(*run.left(), 0.25, 1e-15);
  run.answer = 0.25;
  run.propose();
  EXPECT_FALSE(run.left().has_value());  // not the error of this iterate
  EXPECT_TRUE(run.follow());             // but better than it
}

TEST(NewtonProposal, WhatMakesItWorseIsNotFollowedAndTriedLaterEachTime) {
  Solved run;
  run.answer = 3.0;
  std::vector<Index> waits;
  for (int i = 0; i < 3; ++i) {
    run.propose();
    EXPECT_FALSE(run.follow());
    EXPECT_TRUE(run.state.data.isZero(0.0));
    waits.push_back(run.steps_until_due());
  }
  EXPECT_EQ(waits, (std::vector<Index>{8, 16, 32}));
  EXPECT_TRUE(run.proposal.failed_before());
}

TEST(NewtonProposal, SomeColumnsAreFollowedIfMoreThanTheLastTime) {
  Solved run;
  run.columns = 1;
  run.propose();
  EXPECT_FALSE(run.proposal.whole());
  EXPECT_FALSE(run.left().has_value());
  EXPECT_TRUE(run.follow());
  EXPECT_TRUE(run.proposal.failed_before());  // it waits all the same
  EXPECT_EQ(run.steps_until_due(), 8);
  run.propose();
  EXPECT_FALSE(run.follow());
  EXPECT_EQ(run.steps_until_due(), 16);
}

TEST(NewtonProposal, ABodyThatFliesOffIsNotFollowed) {
  Solved run;
  run.answer = 1e9;
  run.proposal = NewtonProposal(
      Metric(Vector::Ones(3)),
      [](State& state, Index) {
        state.data.setConstant(1e9);
        return NewtonOutcome{2, 1.0, 1, 0.0, std::nullopt, Vector(), false};
      },
      [](const State& /*state*/, Matrix& residual) { residual.setZero(); });
  run.propose();
  EXPECT_TRUE(run.proposal.whole());
  EXPECT_FALSE(run.left().has_value());
  EXPECT_FALSE(run.follow());
}

TEST(NewtonProposal, IsNotAskedFromAnAnswerOrFromNonsense) {
  Solved run;
  run.residual.setZero();
  run.propose();
  run.residual(1, 1) = std::numeric_limits<double>::quiet_NaN();
  run.propose();
  EXPECT_EQ(run.calls, 0);
  EXPECT_FALSE(run.proposal.made());
  EXPECT_FALSE(run.follow());
  EXPECT_FALSE(run.proposal.failed_before());
}

TEST(NewtonProposal, IsGivenUpWhereTheMethodDoesNotExist) {
  State state{Matrix::Zero(3, 1), Matrix::Zero(3, 1)};
  Matrix residual = Matrix::Ones(3, 1);
  NewtonProposal proposal(
      Metric(Vector::Ones(3)),
      [](State&, Index) -> NewtonOutcome { throw latin::NumericalError("no flexibility"); }, {});
  EXPECT_EQ(proposal.propose({state, residual}).steps, 0);
  EXPECT_FALSE(proposal.made());
  EXPECT_FALSE(proposal.possible());
}
