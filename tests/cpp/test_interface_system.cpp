#include <gtest/gtest.h>

#include "bars.hpp"
#include "substructure/interface_system.hpp"

namespace latin::substructure {

TEST(InterfaceSystem, SuitsNonlinearLawsOfUntransformedColumns) {
  EXPECT_FALSE(InterfaceSystem::suits(chain::Bars{}.build()));  // linear
  const chain::Bars bars{.paired = false, .joint_law = "contact"};
  const Laws laws = bars.build();
  EXPECT_TRUE(InterfaceSystem::suits(laws));
  const Matrix one = Matrix::Identity(1, 1);
  EXPECT_FALSE(
      InterfaceSystem::suits(laws.with_columns("joint1", {{0, 1, {{one, one, {}, {}, {}}}, {}}})));
}

TEST(InterfaceSystem, AsksTheLawsAsTheLocalStageDoes) {
  // with memory: each column knows those before it
  const Laws laws =
      chain::Bars{.parts = 3, .paired = false, .joint_law = "coulomb"}.build().with_steps(2);
  const InterfaceSystem system(laws);
  LocalStage local(laws, 4);
  const Index rows = laws.structure().rows();
  const Matrix data = Matrix::Random(rows, 4);
  const Matrix traces = Matrix::Random(rows, 4);
  const Matrix jumps = system.free_jumps(data, traces);
  ASSERT_EQ(jumps.rows(), 4);
  EXPECT_EQ(system.unknowns(), 4);
  InterfaceSystem::Memory memory;
  for (Index column = 0; column < 4; ++column) {
    if (column % 2 == 0) {
      memory = system.blank();
    }
    const Vector before = system.forces(column, memory, jumps.col(column), system.direct());
    const Vector forces = system.advance(column, memory, jumps.col(column), system.direct());
    EXPECT_EQ((before - forces).norm(), 0.0);
    for (std::size_t i = 0; i < 4; ++i) {
      const Matrix force = local.force(i, data, traces);
      EXPECT_LT(std::abs(forces(static_cast<Index>(i)) - force(0, column)), 1e-14);
    }
  }
  EXPECT_EQ(system.asked(), 4 * 2 * 4);
  EXPECT_EQ(system.layout().first, (std::vector<Index>{0, 1, 2, 3}));
  EXPECT_EQ(system.layout().components, (std::vector<Index>{1, 1, 1, 1}));
}

TEST(InterfaceSystem, SlopesAreThoseOfTheForces) {
  const Laws laws = chain::Bars{.parts = 3, .paired = false, .joint_law = "contact"}.build();
  const InterfaceSystem system(laws);
  const Vector& c = system.direct();
  Vector jumps(4);
  jumps << -0.5, 0.3, 0.7, -0.2;  // closed, open, wall, pull
  const Matrix slopes = system.slopes(0, system.blank(), jumps, c);
  EXPECT_NEAR(slopes(0, 0), 1.0 / c(0), 1e-12);
  EXPECT_EQ(slopes(1, 0), 0.0);
  EXPECT_NEAR(slopes(2, 0), 1.0 / c(2), 1e-6);  // perfect: by differences
  EXPECT_NEAR(slopes(3, 0), 0.0, 1e-12);        // a given force
}

TEST(InterfaceSystem, SlopesOfAllColumnsAreThoseOfEach) {
  for (const char* law : {"contact", "coulomb"}) {
    const Laws laws =
        chain::Bars{.parts = 3, .paired = false, .joint_law = law}.build().with_steps(2);
    const InterfaceSystem system(laws);
    Matrix jumps(4, 4);
    jumps << -0.5, 0.3, -0.7, 0.2, 0.3, -1e-3, 0.2, -0.1, 0.7, 1e-5, 0.1, 0.4, -0.2, 0.1, 3.0, 1.0;
    const std::vector<Matrix> all = system.slopes_of_all(jumps, system.direct());
    ASSERT_EQ(all.size(), 4u);
    InterfaceSystem::Memory memory;
    for (Index column = 0; column < 4; ++column) {
      if (column % 2 == 0) {
        memory = system.blank();
      }
      const Matrix one = system.slopes(column, memory, jumps.col(column), system.direct());
      EXPECT_LT((one - all[static_cast<std::size_t>(column)]).cwiseAbs().maxCoeff(), 1e-14);
      system.advance(column, memory, jumps.col(column), system.direct());
    }
  }
}

}  // namespace latin::substructure
