#include <gtest/gtest.h>

#include <limits>

#include "chain.hpp"

namespace latin::substructure {

TEST(Size, AnErrorIsTheLargerOfItsShares) {
  const Size whole{4.0, 1.0, 10.0};
  EXPECT_DOUBLE_EQ((Size{0.04, 0.0, 0.0}).relative_to(whole), 0.1);
  EXPECT_DOUBLE_EQ((Size{0.0, 0.2, 0.0}).relative_to(whole), 0.2);
  EXPECT_EQ((Size{}).relative_to({}), 0.0);
  EXPECT_EQ((Size{1.0, 0.0, 0.0}).relative_to({}), std::numeric_limits<double>::infinity());
  // the strain of a rigid motion is rounding
  EXPECT_NEAR((Size{1e-14, 0.01, 0.0}).relative_to({1e-14, 1.0, 1.0}), 0.1, 1e-12);
}

TEST(Size, DistanceAndDifferenceAgree) {
  const Laws laws = chain::Scene{.parts = 3}.build();
  const Structure& structure = laws.structure();
  GlobalStage global(laws);
  const Matrix one = Matrix::Random(5, 2);
  const Matrix two = Matrix::Random(5, 2);
  Matrix w1(5, 2);
  Matrix w2(5, 2);
  global.apply(one, Matrix::Ones(1, 2), w1);
  global.apply(two, Matrix::Ones(1, 2), w2);
  const Size share = share_of_distance(structure, one, w1, two, w2);
  const Size whole = difference_size(structure, one - two, w1 - w2);
  EXPECT_NEAR(share.strain, whole.strain, 1e-13);
  EXPECT_NEAR(share.trace, whole.trace, 1e-13);
  EXPECT_GT(whole.strain, 0.0);
  EXPECT_NEAR(squared_traces(structure, w1 - w2), whole.trace, 1e-13);
}

}  // namespace latin::substructure
