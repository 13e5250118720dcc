#include <gtest/gtest.h>

#include "fixed_point.hpp"
#include "iteration/step.hpp"

using fixed_point::Linear;
using fixed_point::random;
using fixed_point::weights;
using latin::Index;
using latin::Matrix;
using latin::MatrixRef;
using latin::iteration::Anderson;
using latin::iteration::FixedPoint;
using latin::iteration::Metric;
using latin::iteration::State;
using latin::iteration::Stepper;

namespace {

/// Residual after so many steps from zero.
double residual_after(int steps, Stepper::Kind kind, const Linear& point, double relaxation = 1.0) {
  Anderson history(Metric(weights(6)), 1, 10);
  Stepper stepper(point.stages(), history, relaxation);
  State state = point.state(Matrix::Zero(6, 1));
  Matrix residual = point.residual(state.data);
  for (int i = 0; i < steps; ++i) {
    history.fit(residual);
    stepper.step(kind, {state, residual});
    EXPECT_LT((state.traces - point.trace * state.data).norm(), 1e-12);
    EXPECT_LT((residual - point.residual(state.data)).norm(), 1e-12);
  }
  return residual.norm();
}

}  // namespace

TEST(Stepper, AcceleratedStepsEndAfterOneForEachUnknown) {
  EXPECT_LT(residual_after(7, Stepper::Kind::accelerated, {}), 1e-11);
  EXPECT_GT(residual_after(7, Stepper::Kind::plain, {}), 1e-6);
}

TEST(Stepper, PlainAndAveragedStepsAreTheRelaxedResidual) {
  const Linear point;
  const Matrix before = point.residual(Matrix::Zero(6, 1));
  const auto norm_after = [&](double share) { return point.residual(share * before).norm(); };
  EXPECT_NEAR(residual_after(1, Stepper::Kind::plain, point, 0.9), norm_after(0.9), 1e-14);
  EXPECT_NEAR(residual_after(1, Stepper::Kind::averaged, point, 0.9), norm_after(0.8), 1e-14);
  EXPECT_NEAR(residual_after(1, Stepper::Kind::averaged, point, 0.5), norm_after(0.5), 1e-14);
}

TEST(Stepper, PlainStepsArePreconditionedAveragedOnesAreNot) {
  const Linear point;
  FixedPoint stages = point.stages();
  stages.precondition = [](MatrixRef block) { block *= 0.25; };
  Anderson history(Metric(weights(6)), 1, 2);
  Stepper stepper(stages, history, 1.0);
  const Matrix before = point.residual(Matrix::Zero(6, 1));
  for (const auto& [kind, share] :
       {std::pair{Stepper::Kind::plain, 0.25}, {Stepper::Kind::averaged, 0.8}}) {
    State state = point.state(Matrix::Zero(6, 1));
    Matrix residual = before;
    stepper.step(kind, {state, residual});
    EXPECT_LT((state.data - share * before).norm(), 1e-14);
  }
}

TEST(Stepper, TheHistoryLearnsWhatACoarseProblemAdds) {
  const Linear point;
  const Matrix coarse = random(6, 1, 8);
  FixedPoint stages = point.stages();
  stages.global = [&](Matrix& step, Matrix& data, Matrix& traces) {
    data += coarse;
    step += coarse;
    traces = point.trace * data;
  };
  Anderson history(Metric(weights(6)), 1, 2);
  Stepper stepper(stages, history, 1.0);
  State state = point.state(Matrix::Zero(6, 1));
  Matrix residual = point.residual(state.data);
  const Matrix before = residual;
  stepper.step(Stepper::Kind::plain, {state, residual});
  history.fit(residual);
  EXPECT_LT((history.difference(0).data - (before + coarse)).norm(), 1e-14);
  EXPECT_LT((history.difference(0).traces - state.traces).norm(), 1e-13);
}

TEST(Stepper, AStepTooLongIsNotTaken) {
  // the map hardly moves anything: the history sends the iterate far away
  Linear point;
  point.map = (1.0 - 1e-9) * Matrix::Identity(6, 6);
  Anderson history(Metric(weights(6)), 1, 5);
  Stepper stepper(point.stages(), history, 1.0, 1e7);
  State state = point.state(Matrix::Zero(6, 1));
  Matrix residual = point.residual(state.data);
  history.fit(residual);
  stepper.step(Stepper::Kind::accelerated, {state, residual});
  const Matrix before = state.data;
  const Matrix last = residual;
  history.fit(residual);
  stepper.step(Stepper::Kind::accelerated, {state, residual});
  EXPECT_LT((state.data - before - 0.8 * last).norm(), 1e-12);
  EXPECT_EQ(history.size(), 1);
}

TEST(Stepper, StartsFromTheBestCombinationOfSnapshots) {
  const Linear point;
  std::vector<State> states;
  for (unsigned i = 0; i < 4; ++i) {
    states.push_back(point.state(random(6, 1, 70 + i)));
  }
  Anderson history(Metric(weights(6)), 1, 10);
  Stepper stepper(point.stages(), history, 1.0);
  State state;
  Matrix residual(6, 1);
  stepper.start_from({&states[0], &states[1], &states[2], &states[3]}, {state, residual});
  EXPECT_LT((state.traces - point.trace * state.data).norm(), 1e-12);
  // nothing along the differences makes its residual smaller
  const Matrix best = point.residual(state.data);
  for (std::size_t i = 1; i < 4; ++i) {
    const Matrix along = states[i].data - states[0].data;
    const Matrix change = point.map * along - along;
    EXPECT_NEAR((change.transpose() * weights(6).asDiagonal() * best)(0, 0), 0.0, 1e-12);
  }
  // one snapshot is taken as it is
  Anderson none(Metric(weights(6)), 1, 10);
  Stepper(point.stages(), none, 1.0).start_from({&states[2]}, {state, residual});
  EXPECT_EQ(state.data, states[2].data);
}

TEST(Stepper, SetsSideBySideAreEachAsIfAlone) {
  constexpr Index sets = 3;
  std::vector<Linear> points(sets);
  for (Index set = 0; set < sets; ++set) {
    points[static_cast<std::size_t>(set)].constant = random(6, 1, 80 + static_cast<unsigned>(set));
  }
  Linear all;
  all.constant.resize(6, sets);
  for (Index set = 0; set < sets; ++set) {
    all.constant.col(set) = points[static_cast<std::size_t>(set)].constant;
  }
  std::vector<State> states;
  for (unsigned i = 0; i < 3; ++i) {
    states.push_back(all.state(random(6, 1, 70 + i)));
  }
  const std::vector<const State*> snapshots{&states[0], &states[1], &states[2]};
  const auto advance = [&](const Linear& point, Index count) {
    Anderson history(Metric(weights(6)), 1, 3, count);
    Stepper stepper(point.stages(), history, 0.9);
    State state;
    Matrix residual(6, count);
    stepper.start_from(snapshots, {state, residual});
    residual = point.residual(state.data);
    history.fit(residual);
    stepper.step(Stepper::Kind::accelerated, {state, residual});
    history.fit(residual);
    return std::pair{state, history.predicted_error()};
  };
  const auto [together, wrong] = advance(all, sets);
  for (Index set = 0; set < sets; ++set) {
    const auto [alone, own] = advance(points[static_cast<std::size_t>(set)], 1);
    EXPECT_LT((together.data.col(set) - alone.data).norm(), 1e-11);
    EXPECT_LT((together.traces.col(set) - alone.traces).norm(), 1e-11);
    EXPECT_LT((wrong.data.col(set) - own.data).norm(), 1e-9);
  }
}
