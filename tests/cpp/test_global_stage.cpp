#include <gtest/gtest.h>

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

TEST(GlobalStage, SizeIsTheEnergyOfTheBars) {
  // two bars in series under the force 2: the answer has u^T K u = 2 (2^2)
  const chain::Scene scene;
  const Laws laws = scene.build();
  iteration::State state;
  const auto options = chain::options();
  iteration::solve(laws, options, Matrix::Ones(1, 1), state, {}, {});
  const Size size = GlobalStage(laws).size(state.data, state.traces, Matrix::Ones(1, 1));
  EXPECT_NEAR(size.strain, 8.0, 1e-8);
  EXPECT_GT(size.trace, 0.0);
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
