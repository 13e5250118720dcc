#include <gtest/gtest.h>

#include "fixed_point.hpp"
#include "iteration/verification.hpp"
#include "pushed.hpp"

namespace latin::iteration {
namespace {

using substructure::Laws;

State solved(const Laws& laws, const Matrix& amplitudes) {
  State state;
  const Summary summary = solve(laws, chain::options(10, 1e-9), amplitudes, state, {}, {});
  EXPECT_EQ(summary.status, Status::converged) << summary.error;
  return state;
}

/// What a check says of an answer with wrong data, and what is true.
struct Checked {
  chain::Evaluated at;
  Verification verification;
  Whole whole;
  std::optional<Verification::Found> found;
  Matrix truth;
  Matrix truth_better;

  Checked(const Laws& laws, const Matrix& amplitudes, const State& exact, const Matrix& wrong,
          double rtol)
      : at(laws, amplitudes, exact.data + wrong),
        verification(at.stages),
        whole(at.stages.whole(at.state)),
        found(verification.check(at.state, at.residual, whole, rtol)) {
    const Gauge gauge = gauge_of(laws);
    const Whole answer = at.stages.whole(exact);
    truth = answer.relative(gauge.of_distance(at.state, exact));
    truth_better = answer.relative(gauge.of_distance(verification.better(), exact));
  }
  /// Errors that are not far below the tolerance are found within a tenth.
  void expect_found(double least) const {
    ASSERT_TRUE(found.has_value());
    ASSERT_EQ(found->errors.rows(), truth.rows());
    ASSERT_EQ(found->errors.cols(), truth.cols());
    for (Index i = 0; i < truth.size(); ++i) {
      EXPECT_NEAR(found->errors(i), truth(i), std::max(0.1 * truth(i), least)) << i;
    }
  }
};

}  // namespace

class VerifiedChain : public testing::TestWithParam<std::tuple<double, double>> {};

TEST_P(VerifiedChain, TheErrorIsFoundWithinATenth) {
  const auto [direction, size] = GetParam();
  const Laws laws = chain::Scene{.parts = 4, .direction = direction}.build();
  const Matrix one = Matrix::Ones(1, 1);
  ASSERT_TRUE(Verification::possible(laws));
  const State exact = solved(laws, one);
  const Matrix wrong = size * exact.data.norm() * fixed_point::random(7, 1, 3);
  const double rtol = 0.1 * size;
  const Checked checked(laws, one, exact, wrong, rtol);
  EXPECT_GT(checked.truth.minCoeff(), rtol);
  checked.expect_found(0.0);
  EXPECT_LE(checked.found->errors_better.maxCoeff(), rtol);
  EXPECT_LE(checked.truth_better.maxCoeff(), 1.1 * checked.found->errors_better.maxCoeff());
}

INSTANTIATE_TEST_SUITE_P(Directions, VerifiedChain,
                         testing::Combine(testing::Values(1e-2, 1.0, 1e2),
                                          testing::Values(1e-6, 1e-3, 0.1)));

TEST(Verification, ALightBodyDoesNotHideBesideAHeavyOne) {
  // the pair carries 1e-6 of the load of the bar beside it, and is wrong by half of its own displacement
  const Laws laws = chain::Pushed{.force = -1e-6}.build();
  const Matrix one = Matrix::Ones(1, 1);
  const State exact = solved(laws, one);
  Matrix wrong = Matrix::Zero(4, 1);
  wrong(0) = 0.5 * exact.data(0);
  const Checked checked(laws, one, exact, wrong, 1e-3);
  EXPECT_GT(checked.truth(0, 0), 0.05);
  checked.expect_found(1e-5);  // of what tangents of a closed contact leave
  EXPECT_LT(checked.found->errors(0, 2), 1e-6);
}

TEST(Verification, AFluctuationDoesNotHideBesideItsMean) {
  const Laws laws = chain::Scene{.parts = 3}.build().with_modes(3);
  const Matrix amplitudes = (Matrix(1, 3) << 1.0, 1e-4, -2e-4).finished();
  const State exact = solved(laws, amplitudes);
  Matrix wrong = Matrix::Zero(5, 3);
  wrong.col(1) = 0.1 * exact.data.col(1);
  const Checked checked(laws, amplitudes, exact, wrong, 1e-3);
  EXPECT_LT(checked.truth.row(0).maxCoeff(), 1e-9);
  EXPECT_GT(checked.truth.row(1).minCoeff(), 1e-2);
  checked.expect_found(1e-9);
}

TEST(Verification, AnOpenContactThatHasToCloseIsNeverTakenForAnswer) {
  const chain::Pushed scene{.force = -1e-2, .gap = 1.0};
  const Laws laws = scene.build();
  const Matrix one = Matrix::Ones(1, 1);
  const State exact = solved(laws, one);
  EXPECT_LT((exact.traces - scene.exact()).norm(), 1e-7);
  for (const double left : {0.9, 0.1, 0.03}) {  // of the gap
    Matrix wrong = Matrix::Zero(4, 1);
    wrong(2) = left * scene.direction;
    const Checked checked(laws, one, exact, wrong, 1e-3);
    EXPECT_GT(checked.truth(0, 1), 0.5 * left);
    if (checked.found) {
      checked.expect_found(1e-6);
    }
  }
}

TEST(Verification, ContactInFlightIsFoundBySearch) {
  for (const double gap : {1.0, 100.0, 1e4}) {
    const chain::Pushed scene{.gap = gap};
    const Laws laws = scene.build();
    chain::Evaluated at(laws, Matrix::Ones(1, 1));
    Verification verification(at.stages);
    const double least = 1e-9 * at.norm();
    ASSERT_TRUE(verification.search(at.state, at.residual, least, 500)) << gap;
    EXPECT_LE(metric_of(laws.structure()).norm(verification.better_residual()), least) << gap;
    EXPECT_LT((verification.better().traces - scene.exact()).norm(), 1e-6 * scene.exact().norm())
        << gap;
  }
}

TEST(Verification, ASearchThatFindsNothingBetterSaysSo) {
  // pulled, not pushed: nothing ever holds the loose bar
  const Laws laws = chain::Pushed{.force = 1.0}.build();
  chain::Evaluated at(laws, Matrix::Ones(1, 1));
  Verification verification(at.stages);
  const double first = at.norm();
  const bool fell = verification.search(at.state, at.residual, 1e-9 * first, 500);
  const double last = metric_of(laws.structure()).norm(verification.better_residual());
  EXPECT_EQ(fell, last < first);
  EXPECT_GT(last, 0.1);  // its load is carried by nothing
}

TEST(Verification, StepsThatRememberAreCheckedOneByOne) {
  const chain::Sliding scene;
  const Laws laws = scene.build().with_steps(4);
  ASSERT_TRUE(laws.remembers());
  ASSERT_TRUE(Verification::possible(laws));
  // pushed: it sticks, slips, slips back, sticks
  const Matrix loads = (Matrix(2, 4) << 1.0, 1.0, 1.0, 1.0, 0.2, 1.0, 0.2, 0.4).finished();
  const State exact = solved(laws, loads);
  const Vector slipped = scene.compliance() * Vector{{0.0, 0.7, 0.5, 0.5}};
  EXPECT_LT((exact.traces.row(1).transpose() - slipped).norm(), 1e-9);
  Matrix wrong = Matrix::Zero(4, 4);
  wrong(1, 1) = 0.02;
  wrong(3, 2) = -0.03;
  const Checked checked(laws, loads, exact, wrong, 1e-3);
  EXPECT_GT(checked.truth(1, 0), 1e-3);
  EXPECT_GT(checked.truth(2, 0), 1e-3);
  checked.expect_found(1e-4);
  EXPECT_LT(checked.truth_better.maxCoeff(), 1e-4);
}

TEST(Verification, LongHistoriesWithMemoryAreNotChecked) {
  const Laws friction = chain::Sliding{}.build();
  EXPECT_TRUE(Verification::possible(friction.with_steps(16)));
  EXPECT_FALSE(Verification::possible(friction.with_steps(17)));
  EXPECT_TRUE(Verification::possible(chain::Pushed{}.build().with_steps(100)));  // no memory
}

TEST(Verification, ARunWithALightPairBesideAHeavyBarIsRightInBoth) {
  for (const double ratio : {1e-2, 1e-4, 1e-6}) {
    for (const double rtol : {1e-2, 1e-3, 1e-5}) {
      const chain::Pushed scene{.force = -ratio, .gap = 10.0 * ratio};
      const Laws laws = scene.build();
      State state;
      Options options = chain::options(10, rtol);
      const Summary summary = solve(laws, options, Matrix::Ones(1, 1), state, {}, {});
      ASSERT_EQ(summary.status, Status::converged) << ratio << " " << rtol;
      ASSERT_EQ(summary.errors.cols(), 3);
      EXPECT_EQ(summary.error, summary.errors.maxCoeff());
      const Vector exact = scene.exact();
      for (const auto& [first, rows] : {std::pair{0, 2}, std::pair{2, 1}, std::pair{3, 1}}) {
        EXPECT_LT((state.traces.middleRows(first, rows) - exact.segment(first, rows)).norm(),
                  3.0 * rtol * exact.segment(first, rows).norm())
            << ratio << " " << rtol << " " << first;
      }
    }
  }
}

}  // namespace latin::iteration
