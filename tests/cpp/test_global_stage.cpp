#include <gtest/gtest.h>

#include <cmath>

#include "chain.hpp"

namespace latin::substructure {

TEST(GlobalStage, IsAffineInDataAndLoads) {
  const Laws laws = chain::Scene{.parts = 3}.build();
  GlobalStage global(laws);
  const Matrix data = Matrix::Random(5, 2);
  const Matrix amplitudes = Matrix::Random(1, 2);
  Matrix traces(5, 2);
  Matrix of_data(5, 2);
  Matrix of_loads(5, 2);
  global.apply(data, amplitudes, traces);
  global.apply(data, Matrix::Zero(1, 2), of_data);
  global.apply(Matrix::Zero(5, 2), amplitudes, of_loads);
  EXPECT_LT((traces - of_data - of_loads).norm(), 1e-13);
}

TEST(GlobalStage, AChangeInSinglePrecisionIsThatOfTheData) {
  const Laws laws = chain::Scene{.parts = 3}.build();
  GlobalStage global(laws);
  const Matrix data = Matrix::Random(5, 2);
  const Matrix change = 1e-3 * Matrix::Random(5, 2);
  const Matrix amplitudes = Matrix::Ones(1, 2);
  Matrix traces(5, 2);
  Matrix exact(5, 2);
  global.apply(data, amplitudes, traces);
  global.change(change, traces);
  global.apply(data + change, amplitudes, exact);
  EXPECT_LT((traces - exact).norm(), 1e-9);
}

TEST(GlobalStage, SizesAreThoseOfEveryBar) {
  // two bars in series under the force 2: the answer has u^T K u = 2 (2^2)
  const chain::Scene scene;
  const Laws laws = scene.build();
  iteration::State state;
  const auto options = chain::options();
  iteration::solve(laws, options, Matrix::Ones(1, 1), state, {}, {});
  const Sizes sizes = GlobalStage(laws).sizes(state.data, state.traces, Matrix::Ones(1, 1));
  ASSERT_EQ(sizes.strain.rows(), 1);
  ASSERT_EQ(sizes.strain.cols(), 2);
  EXPECT_NEAR(sizes.strain(0, 0), 4.0, 1e-8);
  EXPECT_NEAR(sizes.strain(0, 1), 4.0, 1e-8);
  // faces: the first bar from 0 to 2, the second at 2 and the joint's 2/3
  EXPECT_NEAR(sizes.trace(0, 0), 4.0, 1e-8);
  EXPECT_NEAR(sizes.trace(0, 1), std::pow(8.0 / 3.0, 2), 1e-8);
  // |w f|: 0 at the wall, 2 * 2 at the joint, and 8/3 * 2
  EXPECT_NEAR(sizes.work(0, 0), 4.0, 1e-8);
  EXPECT_NEAR(sizes.work(0, 1), 16.0 / 3.0, 1e-8);
}

TEST(GlobalStage, SizesOfStepsAreApartAndThoseOfModesAreMeanAndFluctuation) {
  const chain::Scene scene;
  const Laws laws = scene.build();
  iteration::State state;
  // two steps of three modes: 1, 2 | 3, 0 | 4, 1
  const Matrix amplitudes = (Matrix(1, 6) << 1.0, 2.0, 3.0, 0.0, 4.0, 1.0).finished();
  const auto options = chain::options();
  iteration::solve(laws, options, amplitudes, state, {}, {});
  const Sizes sizes =
      GlobalStage(laws.with_steps(2).with_modes(3)).sizes(state.data, state.traces, amplitudes);
  ASSERT_EQ(sizes.strain.rows(), 4);
  const Vector squares = (Vector(4) << 1.0, 9.0 + 16.0, 4.0, 1.0).finished();
  for (Index body = 0; body < 2; ++body) {
    EXPECT_LT((sizes.strain.col(body) - 4.0 * squares).norm(), 1e-7);
  }
}

TEST(Displacements, AreThoseOfEverySubstructure) {
  const chain::Scene scene;
  const Laws laws = scene.build();
  iteration::State state;
  const auto options = chain::options();
  iteration::solve(laws, options, Matrix::Ones(1, 1), state, {}, {});
  const auto fields = displacements(laws, state.data, Matrix::Ones(1, 1));
  ASSERT_EQ(fields.size(), 2U);
  EXPECT_EQ(fields[0].first, "bar0");
  EXPECT_NEAR(fields[0].second(4, 0), 2.0, 1e-8);
  EXPECT_NEAR(fields[1].second(0, 0), 2.0 + 2.0 / 3.0, 1e-8);
}

}  // namespace latin::substructure
