#include <gtest/gtest.h>

#include "chain.hpp"
#include "latin/common/interrupt.hpp"

namespace latin::substructure {

TEST(Flexibility, InvertsTheGlobalStage) {
  // two bars that a wall and a spring hold; only springs mu k hold the second one by itself
  const Laws laws = chain::Scene{}.build();
  const Structure& structure = laws.structure();
  if (!structure.has_flexibility()) {
    GTEST_SKIP() << "the backend does not condense";
  }
  const Flexibility& flexibility = structure.flexibility();
  EXPECT_EQ(flexibility.unknowns(), 2);
  EXPECT_EQ(flexibility.areas(), Vector::Ones(2));
  EXPECT_NEAR(flexibility.direct()(1), 2.0 / 1.3, 1e-14);
  // N = 1 + mu - k A; the modes that are kept apart stand on springs mu k
  constexpr double mu = Flexibility::mu;
  const Matrix v = Matrix::Random(3, 2);
  const Vector held = mu + (1.0 + mu) * (1.0 + mu) * flexibility.modal_stiffness().array();
  const Matrix inverse =
      flexibility.solve(v) +
      flexibility.modal_data(held.cwiseInverse().asDiagonal() * flexibility.modal_loads(v));
  GlobalStage global(laws);
  Matrix traces(3, 2);
  global.apply(inverse, Matrix::Zero(1, 2), traces);
  const Matrix back = (1.0 + mu) * inverse - structure.directions().asDiagonal() * traces;
  EXPECT_LT((back - v).norm(), 1e-5 * v.norm());  // rounding of a rigid motion over mu
}

TEST(Flexibility, IsGivenUpAndMadeAgain) {
  const Laws laws = chain::Scene{}.build();
  const Structure& structure = laws.structure();
  if (!structure.has_flexibility()) {
    GTEST_SKIP() << "the backend does not condense";
  }
  {
    Interruptible ending([] { return true; });
    while (!ending.ends()) {
    }
    EXPECT_THROW(static_cast<void>(structure.flexibility()), Interrupted);
  }
  EXPECT_EQ(structure.flexibility().unknowns(), 2);
}

TEST(Flexibility, SpreadsForcesAndGathersJumps) {
  const Laws laws = chain::Scene{}.build();
  if (!laws.structure().has_flexibility()) {
    GTEST_SKIP() << "the backend does not condense";
  }
  const Flexibility& flexibility = laws.structure().flexibility();
  const Matrix y = (Matrix(2, 1) << 2.0, 5.0).finished();
  const Matrix spread = flexibility.spread(y);
  EXPECT_EQ(spread, (Matrix(3, 1) << 2.0, 5.0, -5.0).finished());
  EXPECT_LT((flexibility.jump(spread) - flexibility.direct().asDiagonal() * y).norm(), 1e-14);
  EXPECT_LT((flexibility.force(spread.col(0)) - y.col(0)).norm(), 1e-14);
}

}  // namespace latin::substructure
