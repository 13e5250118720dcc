#include <gtest/gtest.h>

#include <cmath>

#include "fixed_point.hpp"
#include "latin/iteration/error_estimate.hpp"

using fixed_point::Linear;
using fixed_point::random;
using fixed_point::weights;
using latin::ConstMatrixRef;
using latin::Index;
using latin::Matrix;
using latin::Vector;
using latin::iteration::Anderson;
using latin::iteration::ErrorEstimate;
using latin::iteration::Gauge;
using latin::iteration::Hindsight;
using latin::iteration::Measured;
using latin::iteration::Metric;
using latin::iteration::stage_distance;
using latin::iteration::stage_shares;
using latin::iteration::State;
using latin::substructure::Size;

namespace {

/// Sizes are |s|^2 of the data alone.
Size size_of(ConstMatrixRef data) { return {data.squaredNorm(), 0.0, 0.0}; }
Gauge gauge() {
  return {[](ConstMatrixRef data, ConstMatrixRef /*traces*/) { return size_of(data); },
          [](const State& a, const State& b) { return size_of(a.data - b.data); }};
}

/// What a run measures of a state.
Measured measure(const Linear& point, Anderson& history, const ErrorEstimate& estimate,
                 const State& state) {
  const Matrix residual = point.residual(state.data);
  history.fit(residual);
  return {history.residual_norm(), history.metric().norm(state.data), 0.0, size_of(state.data),
          estimate.shares(state)};
}

void push(const Linear& point, Anderson& history, const Matrix& step) {
  history.push(step, point.map * step - step, point.trace * step);
}

}  // namespace

TEST(Indicator, IsTheDistanceOfTheStagesOverTheirSize) {
  const Vector area = Vector::Constant(1, 2.0);
  const Vector k = Vector::Constant(1, 4.0);
  const State state{Matrix::Constant(1, 1, 7.0), Matrix::Constant(1, 1, 1.5)};
  const Matrix residual = Matrix::Constant(1, 1, 0.8);
  // f = s - k w = 1, f^ = 1.4; w^ = w + 0.4 / k = 1.6
  const double distance = 2.0 * (0.4 * 0.4 / 4.0 + 4.0 * 0.1 * 0.1);
  const double size = 2.0 * ((1.0 + 1.4 * 1.4) / 4.0 + 4.0 * (1.5 * 1.5 + 1.6 * 1.6));
  const auto shares = stage_shares(area, k, state, residual);
  EXPECT_NEAR(shares[0], distance, 1e-14);
  EXPECT_NEAR(shares[1], size, 1e-13);
  EXPECT_NEAR(stage_distance(shares), std::sqrt(distance / size), 1e-14);
  EXPECT_EQ(stage_distance({0.0, 0.0}), 0.0);
}

TEST(ErrorEstimate, IsTheErrorWhereTheHistoryKnowsIt) {
  const Linear point;
  Anderson history(Metric(weights(6)), 1, 6);
  ErrorEstimate estimate(gauge(), 6, 1, 1);
  for (unsigned i = 0; i < 6; ++i) {
    push(point, history, random(6, 1, 10 + i));
  }
  const State state = point.state(point.solution() + 0.01 * random(6, 1, 5));
  const Measured measured = measure(point, history, estimate, state);
  const double truth = (state.data - point.solution()).norm() / state.data.norm();
  EXPECT_NEAR(estimate.by_history(history, state, measured), truth, 1e-8);
}

TEST(ErrorEstimate, TakesWhatIsNotExplainedToBeAmplifiedLikeTheRest) {
  Linear point;
  point.map = 0.5 * Matrix::Identity(6, 6);  // e = 2 r
  Anderson history(Metric(Vector::Ones(6)), 1, 6);
  ErrorEstimate estimate(gauge(), 6, 1, 1);
  push(point, history, Matrix::Identity(6, 6).col(0));
  push(point, history, Matrix::Identity(6, 6).col(1));
  const State state = point.state(point.solution() + 0.01 * Matrix::Ones(6, 1));
  const Measured measured = measure(point, history, estimate, state);
  EXPECT_NEAR(history.explained(), std::sqrt(2.0 / 6.0), 1e-12);
  const double truth = 0.01 * std::sqrt(6.0) / state.data.norm();
  EXPECT_NEAR(estimate.by_history(history, state, measured), truth, 1e-12);
}

TEST(ErrorEstimate, SaysNothingWithoutAHistory) {
  const Linear point;
  Anderson history(Metric(weights(6)), 1, 6);
  ErrorEstimate estimate(gauge(), 6, 1, 2);
  const State state = point.state(random(6, 1, 5));
  EXPECT_TRUE(
      std::isinf(estimate.by_history(history, state, measure(point, history, estimate, state))));
  EXPECT_FALSE(estimate.ready());
  estimate.count_step();
  EXPECT_FALSE(estimate.ready());
  estimate.count_step();
  EXPECT_TRUE(estimate.ready());
  estimate.restart();
  EXPECT_FALSE(estimate.ready());
}

TEST(ErrorEstimate, OfRoundingIsAmplifiedAsTheWorstStepWas) {
  Linear point;
  point.map = (Vector(6) << 0.0, 0.9, 0.0, 0.0, 0.0, 0.0).finished().asDiagonal();
  Anderson history(Metric(Vector::Ones(6)), 1, 6);
  ErrorEstimate estimate(gauge(), 6, 1, 1);
  push(point, history, Matrix::Identity(6, 6).col(0));
  push(point, history, Matrix::Identity(6, 6).col(1));  // |dS| = 10 |dR|
  const State state = point.state(point.solution());
  Measured measured = measure(point, history, estimate, state);
  history.fit(1e-16 * Matrix::Ones(6, 1));
  measured.residual = history.residual_norm();
  EXPECT_NEAR(estimate.by_history(history, state, measured),
              10.0 * measured.residual / state.data.norm(), 1e-24);
}

TEST(ErrorEstimate, IsNotFarBelowTheIndicator) {
  const Linear point;
  Anderson history(Metric(weights(6)), 1, 6);
  ErrorEstimate estimate(gauge(), 6, 1, 1);
  for (unsigned i = 0; i < 6; ++i) {
    push(point, history, random(6, 1, 10 + i));
  }
  const State state = point.state(point.solution() + 1e-6 * random(6, 1, 5));
  Measured measured = measure(point, history, estimate, state);
  measured.indicator = 0.5;
  EXPECT_EQ(estimate.by_history(history, state, measured), 0.3 * 0.5);
  EXPECT_EQ(estimate.by_step(point.state(Matrix::Zero(6, 1)), 0.0, measured), 0.3 * 0.5);
}

TEST(ErrorEstimate, ByAStepCountsWhatTheStepLeaves) {
  const Linear point;
  const ErrorEstimate estimate(gauge(), 6, 1, 1);
  Measured measured;
  measured.whole = {4.0, 0.0, 0.0};
  const State step{Matrix::Constant(1, 1, 0.1), Matrix::Zero(1, 1)};
  EXPECT_NEAR(estimate.by_step(step, 0.0, measured), 0.05, 1e-15);
  EXPECT_NEAR(estimate.by_step(step, 0.2, measured), 0.0625, 1e-15);
}

/// Two parts of an error: one that every step sees, and one that hardly moves.
TEST(Hindsight, SeesWhatTheStepsDidNot) {
  const Gauge measure = gauge();
  Hindsight hindsight(2, 1);
  const auto state = [](double seen, double hidden) {
    return State{(Matrix(2, 1) << 1.0 + seen, 1.0 + hidden).finished(), Matrix::Zero(2, 1)};
  };
  const Size whole{2.0, 0.0, 0.0};
  EXPECT_EQ(hindsight.raised(1e-3, 1.0, whole, hindsight.shares(measure, state(0.0, 0.0))), 1e-3);
  hindsight.keep(state(1e-3, 0.1), 1e-3, 1.0);
  // at an iterate without the hidden part its distance to the one kept is 0.1, whose estimate was 1e-3; since
  // then the estimate has fallen by 4 and the residual by 16
  const auto shares = hindsight.shares(measure, state(0.0, 0.0));
  EXPECT_NEAR(hindsight.raised(1e-3 / 4.0, 1.0 / 16.0, whole, shares),
              std::hypot(0.1, 1e-3) / std::sqrt(2.0) / 2.0 / 4.0, 1e-12);
  // no fall raises above what was wrong then
  EXPECT_NEAR(hindsight.raised(2e-3, 2.0, whole, shares), std::hypot(0.1, 1e-3) / std::sqrt(2.0),
              1e-12);
  // rounding is not raised
  EXPECT_EQ(hindsight.raised(1e-12, 1.0, whole, shares), 1e-12);
}

TEST(Hindsight, KeepsIteratesWellApart) {
  const Gauge measure = gauge();
  Hindsight hindsight(1, 1);
  const auto state = [](double value) {
    return State{Matrix::Constant(1, 1, value), Matrix::Zero(1, 1)};
  };
  hindsight.keep(state(8.0), std::numeric_limits<double>::infinity(), 1.0);  // not known
  hindsight.keep(state(4.0), 0.1, 1.0);
  hindsight.keep(state(3.0), 0.1, 0.3);  // not well below
  hindsight.keep(state(2.0), 0.1, 0.1);
  auto shares = hindsight.shares(measure, state(0.0));
  EXPECT_EQ(shares[0], 4.0);
  EXPECT_EQ(shares[2], 16.0);
  hindsight.keep(state(1.0), 0.1, 0.01);  // the oldest makes room
  shares = hindsight.shares(measure, state(0.0));
  EXPECT_EQ(shares[0], 1.0);
  EXPECT_EQ(shares[2], 4.0);
}
