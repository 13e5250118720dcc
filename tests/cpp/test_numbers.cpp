#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "bars.hpp"
#include "common/numbers.hpp"
#include "iteration/error_estimate.hpp"
#include "iteration/linearisation.hpp"
#include "iteration/stages.hpp"
#include "latin/common/communicator.hpp"

using latin::Index;
using latin::Matrix;
using latin::Vector;

namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();

}  // namespace

TEST(Numbers, MaximaKeepANanWhereverItIs) {
  EXPECT_TRUE(std::isnan(latin::larger(none, 1.0)));
  EXPECT_TRUE(std::isnan(latin::larger(1.0, none)));
  EXPECT_EQ(latin::larger(1.0, 2.0), 2.0);
  EXPECT_EQ(latin::larger(2.0, 1.0), 2.0);
  EXPECT_TRUE(std::isnan(latin::largest_of({1.0, none, 3.0})));
  EXPECT_EQ(latin::largest_of(std::vector<double>{1.0, 3.0, 2.0}, 0.0), 3.0);
  for (Index at = 0; at < 9; ++at) {
    Matrix one = Matrix::Ones(3, 3);
    const Matrix two = Matrix::Constant(3, 3, 2.0);
    one(at) = none;
    EXPECT_TRUE(std::isnan(latin::larger(one, two)(at)));
    EXPECT_TRUE(std::isnan(latin::larger(two, one)(at)));
    EXPECT_TRUE(std::isnan(latin::larger(one, 2.0)(at)));
    EXPECT_EQ(latin::larger(one, two)((at + 1) % 9), 2.0);
    EXPECT_TRUE(std::isnan(latin::iteration::largest(one)));
  }
  // what decides is larger than any tolerance, on one rank as on several
  EXPECT_EQ(latin::Communicator().largest(none), std::numeric_limits<double>::infinity());
}

TEST(Numbers, CountWhatIndicesOf32BitsCan) {
  EXPECT_EQ(latin::count_of_entries((Index{1} << 31) - 1, "it"), std::numeric_limits<int>::max());
  EXPECT_THROW(latin::count_of_entries(Index{1} << 31, "the stiffness of a body"),
               latin::NumericalError);
  EXPECT_THROW(latin::count_of_entries(-1, "it"), latin::NumericalError);
}

/// Whatever number of an iterate is none, no error that is relative to it is small.
TEST(Numbers, NoErrorIsRelativeToWhatIsNone) {
  const auto laws = chain::Bars{.parts = 2}.build();
  const Matrix one = Matrix::Ones(1, 1);
  latin::iteration::Stages stages(laws, one, false);
  latin::iteration::State state;
  ASSERT_EQ(chain::solved(laws, state).status, latin::iteration::Status::converged);
  const latin::iteration::Whole whole = stages.whole(state);
  const latin::substructure::Sizes nothing =
      latin::substructure::Sizes::zero(whole.sizes.strain.rows(), whole.sizes.strain.cols());
  EXPECT_EQ(latin::iteration::largest(whole.relative(nothing)), 0.0);
  for (const auto field :
       {&latin::substructure::Sizes::strain, &latin::substructure::Sizes::trace,
        &latin::substructure::Sizes::work, &latin::substructure::Sizes::pressed}) {
    latin::iteration::Whole wrong = whole;
    (wrong.sizes.*field)(0, 0) = none;
    EXPECT_TRUE(std::isnan(latin::iteration::largest(wrong.relative(nothing))));
    EXPECT_TRUE(std::isnan(latin::iteration::largest(wrong.relative_with_noise(nothing))));
  }
  for (const auto field :
       {&latin::substructure::Sizes::strain, &latin::substructure::Sizes::trace}) {
    latin::substructure::Sizes error = nothing;
    (error.*field)(0, 0) = none;
    EXPECT_TRUE(std::isnan(latin::iteration::largest(whole.relative(error))));
  }
}

TEST(Numbers, NoColumnIsBalancedByANan) {
  const auto laws = chain::Scene{}.build();
  latin::iteration::State state;
  latin::iteration::solve(laws, chain::options(), Matrix::Ones(1, 1), state, {}, {});
  latin::iteration::Linearisation linear;
  linear.take(laws, state);
  Matrix residual = Matrix::Zero(state.data.rows(), 1);
  EXPECT_EQ(linear.imbalance(laws, state, residual), 0.0);
  residual(0, 0) = none;
  EXPECT_FALSE(linear.imbalance(laws, state, residual) <= 1.0);
  residual.setZero();
  state.data(0, 0) = none;
  EXPECT_FALSE(linear.imbalance(laws, state, residual) <= 1.0);
}

/// An assembled structure whose answer overflows has none.
TEST(Numbers, AnAnswerThatIsNoneIsNotConverged) {
  std::vector<latin::substructure::BodyDescription> bodies;
  Matrix held = Matrix::Identity(1, 1) * 1e-300;
  bodies.push_back({"bar",
                    1,
                    {{"bar",
                      latin::owning_view(latin::SparseRows(held.sparseView(1.0, 0.0))),
                      {},
                      Matrix::Constant(1, 1, 1e10),
                      {}}},
                    {}});
  const latin::substructure::Laws laws(std::make_shared<const latin::substructure::Structure>(
      std::move(bodies), std::vector<latin::substructure::InterfaceDescription>{},
      latin::substructure::OperatorOptions{}));
  latin::iteration::State state;
  const auto summary =
      latin::iteration::solve(laws, chain::options(), Matrix::Ones(1, 1), state, {}, {});
  EXPECT_EQ(summary.status, latin::iteration::Status::undecided) << summary.energy;
  EXPECT_EQ(summary.error, std::numeric_limits<double>::infinity());
}
