#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "fixed_point.hpp"
#include "iteration/error_estimate.hpp"

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
using latin::iteration::largest;
using latin::iteration::Measured;
using latin::iteration::Metric;
using latin::iteration::stage_distance;
using latin::iteration::stage_shares;
using latin::iteration::State;
using latin::iteration::Whole;
using latin::substructure::Sizes;

namespace {

/// One group of one body, of that size.
Sizes sizes(double strain) {
  Sizes sizes = Sizes::zero(1, 1);
  sizes.strain(0, 0) = strain;
  return sizes;
}
Whole whole(double strain) {
  return {sizes(strain), {{}, Vector::Ones(1), Vector::Zero(1), {false}, {0}, Vector::Zero(1)}};
}

/// Sizes are |s|^2 of the data alone.
Gauge gauge() {
  return {[](ConstMatrixRef data, ConstMatrixRef /*traces*/) { return sizes(data.squaredNorm()); },
          [](const State& a, const State& b) { return sizes((a.data - b.data).squaredNorm()); }};
}

/// What a run measures of a state.
Measured measure(const Linear& point, Anderson& history, const State& state) {
  const Matrix residual = point.residual(state.data);
  history.fit(residual);
  const double strain = state.data.squaredNorm();
  return {history.residual_norm(), history.metric().norm(state.data), 0.0, strain, whole(strain)};
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
  const Measured measured = measure(point, history, state);
  const double truth = (state.data - point.solution()).norm() / state.data.norm();
  EXPECT_NEAR(largest(estimate.by_history(history, state, measured)), truth, 1e-8);
}

TEST(ErrorEstimate, TakesWhatIsNotExplainedToBeAmplifiedLikeTheRest) {
  Linear point;
  point.map = 0.5 * Matrix::Identity(6, 6);  // e = 2 r
  Anderson history(Metric(Vector::Ones(6)), 1, 6);
  ErrorEstimate estimate(gauge(), 6, 1, 1);
  push(point, history, Matrix::Identity(6, 6).col(0));
  push(point, history, Matrix::Identity(6, 6).col(1));
  const State state = point.state(point.solution() + 0.01 * Matrix::Ones(6, 1));
  const Measured measured = measure(point, history, state);
  EXPECT_NEAR(history.explained(), std::sqrt(2.0 / 6.0), 1e-12);
  const double truth = 0.01 * std::sqrt(6.0) / state.data.norm();
  EXPECT_NEAR(largest(estimate.by_history(history, state, measured)), truth, 1e-12);
}

TEST(ErrorEstimate, SaysNothingWithoutAHistory) {
  const Linear point;
  Anderson history(Metric(weights(6)), 1, 6);
  ErrorEstimate estimate(gauge(), 6, 1, 2);
  const State state = point.state(random(6, 1, 5));
  const Matrix said = estimate.by_history(history, state, measure(point, history, state));
  ASSERT_EQ(said.size(), 1);
  EXPECT_TRUE(std::isinf(said(0, 0)));
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
  Measured measured = measure(point, history, state);
  history.fit(1e-16 * Matrix::Ones(6, 1));
  measured.residual = history.residual_norm();
  EXPECT_NEAR(largest(estimate.by_history(history, state, measured)),
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
  Measured measured = measure(point, history, state);
  measured.indicator = 0.5;
  EXPECT_EQ(largest(estimate.by_history(history, state, measured)), 0.3 * 0.5);
  EXPECT_EQ(largest(estimate.by_step(point.state(Matrix::Zero(6, 1)), 0.0, measured)), 0.3 * 0.5);
}

TEST(ErrorEstimate, ByAStepCountsWhatTheStepLeaves) {
  const Linear point;
  const ErrorEstimate estimate(gauge(), 6, 1, 1);
  Measured measured;
  measured.whole = whole(4.0);
  const State step{Matrix::Constant(1, 1, 0.1), Matrix::Zero(1, 1)};
  EXPECT_NEAR(largest(estimate.by_step(step, 0.0, measured)), 0.05, 1e-15);
  EXPECT_NEAR(largest(estimate.by_step(step, 0.2, measured)), 0.0625, 1e-15);
}

TEST(ErrorEstimate, TheDistanceOfTheStagesRaisesTheLargestErrorOnly) {
  // two bodies of size 4, wrong by 0.1 and 0.3 of a unit of length: errors 0.05 and 0.15
  const Gauge two{[](ConstMatrixRef data, ConstMatrixRef /*traces*/) {
                    Sizes each = Sizes::zero(1, 2);
                    each.strain = data.cwiseAbs2().transpose();
                    return each;
                  },
                  {}};
  const ErrorEstimate estimate(two, 2, 1, 1);
  Measured measured;
  measured.whole = {
      Sizes::zero(1, 2),
      {{}, Vector::Ones(2), Vector::Zero(2), {false, false}, {0, 0}, Vector::Zero(1)}};
  measured.whole.sizes.strain.setConstant(4.0);
  const State step{(Matrix(2, 1) << 0.1, 0.3).finished(), Matrix::Zero(2, 1)};
  EXPECT_TRUE(estimate.by_step(step, 0.0, measured).isApprox(Matrix{{0.05, 0.15}}, 1e-14));
  measured.indicator = 1.0;
  EXPECT_TRUE(estimate.by_step(step, 0.0, measured).isApprox(Matrix{{0.05, 0.3}}, 1e-14));
}

TEST(ErrorEstimate, TheLargestOfATable) {
  EXPECT_EQ(largest(Matrix{}), 0.0);
  EXPECT_EQ(largest(Matrix{{0.1, 0.3}, {0.2, 0.0}}), 0.3);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(largest(Matrix{{0.1, nan}, {0.2, 0.0}})));
  const ErrorEstimate of_ranks(gauge(), 1, 1, 1, [](double own) { return std::max(own, 0.7); });
  EXPECT_EQ(of_ranks.largest(Matrix{{0.1, 0.3}}), 0.7);
}

/// Two parts of an error: one that every step sees, and one that hardly moves.
TEST(Hindsight, SeesWhatTheStepsDidNot) {
  const Gauge measure = gauge();
  Hindsight hindsight(2, 1);
  const auto state = [](double seen, double hidden) {
    return State{(Matrix(2, 1) << 1.0 + seen, 1.0 + hidden).finished(), Matrix::Zero(2, 1)};
  };
  const State now = state(0.0, 0.0);
  const auto raised = [&](double estimate, double residual) {
    return hindsight.raised(measure, now, Matrix::Constant(1, 1, estimate), estimate, residual,
                            whole(2.0))(0, 0);
  };
  EXPECT_EQ(raised(1e-3, 1.0), 1e-3);
  hindsight.keep(state(1e-3, 0.1), 1e-3, 1.0);
  // at an iterate without the hidden part its distance to the one kept is 0.1, whose estimate was 1e-3; since
  // then the estimate has fallen by 4 and the residual by 16
  const double then = std::hypot(0.1, 1e-3) / std::sqrt(2.0);
  EXPECT_NEAR(raised(1e-3 / 4.0, 1.0 / 16.0), then / 2.0 / 4.0, 1e-12);
  // no fall raises above what was wrong then
  EXPECT_NEAR(raised(2e-3, 2.0), then, 1e-12);
  // rounding is not raised
  EXPECT_EQ(raised(1e-12, 1.0), 1e-12);
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
  // the larger of their distances to 0, each fallen as far as its residual
  const auto raised = [&](double residual) {
    return hindsight.raised(measure, state(0.0), Matrix::Zero(1, 1), 0.1, residual, whole(1.0))(0,
                                                                                                0);
  };
  EXPECT_NEAR(raised(1e-2), std::max(4.0 * std::sqrt(1e-2), 2.0 * std::sqrt(1e-1)), 1e-14);
  hindsight.keep(state(1.0), 0.1, 0.01);  // the oldest makes room
  EXPECT_NEAR(raised(1e-4), std::max(2.0 * std::sqrt(1e-3), 1.0 * std::sqrt(1e-2)), 1e-14);
}
