#include <gtest/gtest.h>

#include "bars.hpp"
#include "latin/substructure/interface_system.hpp"

namespace latin::substructure {

TEST(InterfaceSystem, SuitsNonlinearLawsOfCondensedBodies) {
  EXPECT_FALSE(InterfaceSystem::suits(chain::Bars{}.build(), 1000));  // linear
  chain::Bars bars{.paired = false, .joint_law = "contact"};
  const Laws laws = bars.build();
  EXPECT_EQ(InterfaceSystem::suits(laws, 1000), laws.structure().bodies()[0].condensed());
  EXPECT_FALSE(InterfaceSystem::suits(laws, 8));  // 9 unknowns
  const Matrix one = Matrix::Identity(1, 1);
  EXPECT_FALSE(InterfaceSystem::suits(
      laws.with_columns("joint1", {{0, 1, {{one, one, {}, {}, {}}}, {}}}), 1000));
  bars.kind = OperatorKind::factored;
  EXPECT_FALSE(InterfaceSystem::suits(bars.build(), 1000));
}

TEST(InterfaceSystem, AsksTheLawsAsTheLocalStageDoes) {
  const Laws laws = chain::Bars{.parts = 3, .paired = false, .joint_law = "contact"}.build();
  if (!laws.structure().has_flexibility()) {
    GTEST_SKIP() << "the backend does not condense";
  }
  const InterfaceSystem system(laws);
  LocalStage local(laws, 2);
  const Index rows = laws.structure().rows();
  const Matrix data = Matrix::Random(rows, 2);
  const Matrix traces = Matrix::Random(rows, 2);
  const Matrix jumps = system.free_jumps(data, traces);
  ASSERT_EQ(jumps.rows(), 4);
  EXPECT_EQ(system.unknowns(), 4);
  const Matrix forces = system.forces(jumps, system.flexibility().direct());
  for (std::size_t i = 0; i < 4; ++i) {
    const Matrix force = local.force(i, data, traces);
    EXPECT_LT((forces.row(static_cast<Index>(i)) - force.row(0)).norm(), 1e-14);
  }
  EXPECT_EQ(system.layout().first, (std::vector<Index>{0, 1, 2, 3}));
  EXPECT_EQ(system.layout().components, (std::vector<Index>{1, 1, 1, 1}));
}

TEST(InterfaceSystem, SlopesAreThoseOfTheForces) {
  const Laws laws = chain::Bars{.parts = 3, .paired = false, .joint_law = "contact"}.build();
  if (!laws.structure().has_flexibility()) {
    GTEST_SKIP() << "the backend does not condense";
  }
  const InterfaceSystem system(laws);
  const Vector& c = system.flexibility().direct();
  Matrix jumps(4, 1);
  jumps << -0.5, 0.3, 0.7, -0.2;  // closed, open, wall, pull
  const Matrix slopes = system.slopes(jumps, c, 0);
  EXPECT_NEAR(slopes(0, 0), 1.0 / c(0), 1e-12);
  EXPECT_EQ(slopes(1, 0), 0.0);
  EXPECT_NEAR(slopes(2, 0), 1.0 / c(2), 1e-6);  // perfect: by differences
  EXPECT_NEAR(slopes(3, 0), 0.0, 1e-12);        // a given force
}

}  // namespace latin::substructure
