#include <gtest/gtest.h>

#include <stdexcept>

#include "fixed_point.hpp"
#include "iteration/anderson.hpp"

using fixed_point::Linear;
using fixed_point::random;
using fixed_point::weights;
using latin::Index;
using latin::Matrix;
using latin::MatrixRef;
using latin::Vector;
using latin::iteration::Anderson;
using latin::iteration::least_squares;
using latin::iteration::Metric;

namespace {

/// argmin | r - D gamma | in the metric, by another way.
Vector reference(const Vector& metric, const Matrix& differences, const Vector& residual) {
  const Vector root = metric.cwiseSqrt();
  return (root.asDiagonal() * differences)
      .colPivHouseholderQr()
      .solve(Vector(root.cwiseProduct(residual)));
}

/// A history of `count` differences of a linear fixed point around zero.
Anderson history_of(const Linear& point, Index count, Index depth) {
  Anderson history(Metric(weights(point.rows)), 1, depth);
  for (Index i = 0; i < count; ++i) {
    const Matrix step = random(point.rows, 1, 10 + static_cast<unsigned>(i));
    history.push(step, point.map * step - step, point.trace * step);
  }
  return history;
}

}  // namespace

TEST(LeastSquares, LeavesOutDirectionsThatSayNothingNew) {
  Matrix directions = random(5, 3, 1);
  directions.col(2) = directions.col(0) + directions.col(1);
  const Vector right = directions.col(0) * 2.0 - directions.col(1);
  const auto fit = least_squares(directions.transpose() * directions,
                                 directions.transpose() * right, right.norm());
  EXPECT_TRUE(fit.gamma.allFinite());
  EXPECT_LT((directions * fit.gamma - right).norm(), 1e-10);
  EXPECT_LT(fit.remainder, 1e-6);
}

TEST(LeastSquares, LeavesOutSnapshotsThatAreTheSame) {
  // one is another to rounding or altogether: unit columns of these would be anything
  Matrix directions = random(5, 5, 1);
  directions.col(3) *= 1e-16;
  directions.col(4).setZero();
  const Vector right = directions.col(0) * 2.0 - directions.col(1);
  const auto fit = least_squares(directions.transpose() * directions,
                                 directions.transpose() * right, right.norm());
  EXPECT_EQ(fit.gamma.tail(2), Vector::Zero(2));
  EXPECT_LT((directions * fit.gamma - right).norm(), 1e-10);
  EXPECT_EQ(least_squares(Matrix::Zero(1, 1), Vector::Zero(1), 1.0).remainder, 1.0);
}

TEST(LeastSquares, HasNothingToSayOfNothing) {
  EXPECT_EQ(least_squares(Matrix(0, 0), Vector(0), 1.0).remainder, 1.0);
  EXPECT_EQ(least_squares(Matrix::Identity(2, 2), Vector::Zero(2), 0.0).gamma, Vector::Zero(2));
}

TEST(Anderson, FitsInTheMetric) {
  const Linear point;
  Anderson history = history_of(point, 3, 5);
  const Matrix residual = random(point.rows, 1, 4);
  history.fit(residual);
  Matrix data(6, 3);
  for (Index i = 0; i < 3; ++i) {
    data.col(i) = history.difference(i).data;
  }
  const Matrix differences = point.map * data - data;
  const Vector gamma = reference(weights(6), differences, residual);
  EXPECT_LT((history.predicted_error().data - data * gamma).norm(), 1e-12);
  EXPECT_LT((history.predicted_error().traces - point.trace * data * gamma).norm(), 1e-12);
  const Matrix left = residual - differences * gamma;
  const double norm = history.metric().norm(residual);
  EXPECT_NEAR(history.residual_norm(), norm, 1e-14);
  EXPECT_NEAR(history.remainder(), history.metric().norm(left) / norm, 1e-12);
  EXPECT_NEAR(history.explained(), std::sqrt(1.0 - std::pow(history.remainder(), 2)), 1e-14);

  Matrix step(6, 1);
  history.step(residual, 0.7, {}, step);
  EXPECT_LT((step - (0.7 * left - data * gamma)).norm(), 1e-12);
  // a preconditioner sees what is left, and not the error that is known
  history.step(residual, 0.7, [](MatrixRef block) { block *= 3.0; }, step);
  EXPECT_LT((step - (2.1 * left - data * gamma)).norm(), 1e-12);
}

TEST(Anderson, FindsALinearFixedPointWhenItsDifferencesSpanTheSpace) {
  const Linear point;
  Anderson history = history_of(point, 6, 6);
  history.fit(point.residual(Matrix::Zero(6, 1)));
  EXPECT_LT(history.remainder(), 1e-6);
  EXPECT_LT((history.predicted_error().data + point.solution()).norm(), 1e-10);
}

TEST(Anderson, TheOldestDifferenceMakesRoom) {
  const Linear point;
  const Matrix residual = random(6, 1, 5);
  Anderson all = history_of(point, 5, 3);
  all.fit(residual);
  Anderson last(Metric(weights(6)), 1, 3);
  for (unsigned i = 2; i < 5; ++i) {
    const Matrix step = random(6, 1, 10 + i);
    last.push(step, point.map * step - step, point.trace * step);
  }
  last.fit(residual);
  EXPECT_EQ(all.size(), 3);
  EXPECT_LT((all.predicted_error().data - last.predicted_error().data).norm(), 1e-10);
}

TEST(Anderson, ASecondFitKeepsWhatTheFirstKnew) {
  const Linear point;
  const Matrix residual = random(6, 1, 5);
  Anderson at_once = history_of(point, 4, 4);
  at_once.fit(residual);
  Anderson one_by_one(Metric(weights(6)), 1, 4);
  for (Index i = 0; i < 4; ++i) {
    const Matrix step = at_once.difference(i).data;
    one_by_one.push(step, point.map * step - step, point.trace * step);
    one_by_one.fit(residual);
  }
  EXPECT_LT((at_once.predicted_error().data - one_by_one.predicted_error().data).norm(), 1e-12);
}

TEST(Anderson, ForgetsWhatIsCleared) {
  const Linear point;
  Anderson history = history_of(point, 3, 4);
  const Matrix residual = random(6, 1, 5);
  history.fit(residual);
  history.clear();
  history.fit(residual);
  EXPECT_EQ(history.size(), 0);
  EXPECT_EQ(history.remainder(), 1.0);
  EXPECT_TRUE(history.predicted_error().data.isZero(0.0));
  Matrix step(6, 1);
  history.step(residual, 1.0, {}, step);
  EXPECT_EQ(step, residual);
}

TEST(Anderson, WithoutDepthTakesTheResidual) {
  const Linear point;
  Anderson history = history_of(point, 3, 0);
  const Matrix residual = random(6, 1, 5);
  history.fit(residual);
  EXPECT_EQ(history.size(), 0);
  EXPECT_NEAR(history.residual_norm(), history.metric().norm(residual), 1e-14);
}

TEST(Anderson, SumsEverythingOverTheRanksInOneMessage) {
  // a second rank with the same numbers
  int messages = 0;
  const Metric doubled(weights(6), [&messages](std::span<double> values) {
    ++messages;
    for (double& value : values) {
      value *= 2.0;
    }
  });
  const Linear point;
  Anderson alone = history_of(point, 3, 4);
  Anderson shared(doubled, 1, 4);
  for (Index i = 0; i < 3; ++i) {
    const auto each = alone.difference(i);
    shared.push(each.data, point.map * each.data - each.data, each.traces);
  }
  const Matrix residual = random(6, 1, 5);
  std::array<double, 2> shares{1.0, 5.0};
  alone.fit(residual);
  shared.fit(residual, shares);
  EXPECT_EQ(messages, 1);
  EXPECT_EQ(shares, (std::array<double, 2>{2.0, 10.0}));
  EXPECT_NEAR(shared.residual_norm(), std::sqrt(2.0) * alone.residual_norm(), 1e-14);
  EXPECT_LT((shared.predicted_error().data - alone.predicted_error().data).norm(), 1e-12);
}

/// Sets side by side, two columns each, are what each of them is alone.
TEST(Anderson, SetsSideBySideAreEachAsIfAlone) {
  constexpr Index sets = 3;
  constexpr Index columns = 2;
  constexpr Index common = 3;
  const Metric metric(weights(6));
  Anderson together(metric, columns, common + 1, sets);
  std::vector<Anderson> alone(sets, Anderson(metric, columns, common + 1));
  const auto of = [](const Matrix& block, Index set) {
    return Matrix(block.middleCols(set * columns, columns));
  };
  const auto compare = [&](const Matrix& residual) {
    together.fit(residual);
    Matrix step(6, sets * columns);
    together.step(residual, 0.9, {}, step);
    for (Index set = 0; set < sets; ++set) {
      Anderson& one = alone[static_cast<std::size_t>(set)];
      one.fit(of(residual, set));
      Matrix own(6, columns);
      one.step(of(residual, set), 0.9, {}, own);
      EXPECT_NEAR(together.residual_norm(set), one.residual_norm(), 1e-13);
      EXPECT_NEAR(together.remainder(set), one.remainder(), 1e-12);
      EXPECT_LT((of(step, set) - own).norm(), 1e-11);
      EXPECT_LT((of(together.predicted_error().data, set) - one.predicted_error().data).norm(),
                1e-11);
      EXPECT_LT((of(together.predicted_error().traces, set) - one.predicted_error().traces).norm(),
                1e-11);
    }
  };
  for (unsigned i = 0; i < common; ++i) {
    const Matrix data = random(6, columns, 20 + i);
    const Matrix traces = random(6, columns, 30 + i);
    const Matrix residual = random(6, sets * columns, 40 + i);
    together.push_common(data, residual, traces);
    for (Index set = 0; set < sets; ++set) {
      alone[static_cast<std::size_t>(set)].push_common(data, of(residual, set), traces);
    }
  }
  compare(random(6, sets * columns, 50));
  const Matrix data = random(6, sets * columns, 60);
  const Matrix residual = random(6, sets * columns, 61);
  const Matrix traces = random(6, sets * columns, 62);
  together.push(data, residual, traces);
  for (Index set = 0; set < sets; ++set) {
    alone[static_cast<std::size_t>(set)].push(of(data, set), of(residual, set), of(traces, set));
  }
  compare(random(6, sets * columns, 51));
  EXPECT_THROW(together.push(data, residual, traces), std::logic_error);
}
