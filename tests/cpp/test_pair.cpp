#include <gtest/gtest.h>

#include "bars.hpp"
#include "latin/common/error.hpp"

namespace {

using chain::Bars;
using chain::solved;
using latin::Index;
using latin::Matrix;

TEST(Pair, StepSolvesItsInterface) {
  // two bars: nothing but the joint couples them, and what holds and pulls them is nearly exact
  for (const auto kind : {latin::substructure::OperatorKind::condensed,
                          latin::substructure::OperatorKind::factored}) {
    for (const double stiffness : {1e-6, 3.0, 1e8}) {
      const Bars bars{.parts = 2, .macro = false, .stiffness = stiffness, .kind = kind};
      const latin::substructure::Laws laws = bars.build();
      const latin::substructure::Structure& structure = laws.structure();
      latin::substructure::GlobalStage global(laws);
      latin::substructure::LocalStage local(laws, 2);
      Matrix data = Matrix::Zero(structure.rows(), 2);
      data(structure.interface(0).rows[0], 0) = 1.0;
      data(structure.interface(0).rows[1], 1) = -0.7;
      Matrix traces(structure.rows(), 2);
      Matrix residual(structure.rows(), 2);
      const auto stages = [&] {
        global.apply(data, Matrix::Zero(structure.loads(), 2), traces);
        local.apply(data, traces, residual);
      };
      stages();
      Matrix step = residual;
      laws.precondition(step);
      Matrix rest = residual;
      for (const std::size_t s : {0, 1}) {
        const Index row = structure.interface(0).rows[s];
        data.row(row) += step.row(row);
        rest.row(row).setZero();
      }
      const double before = (residual - rest).norm();
      stages();
      for (const std::size_t s : {0, 1}) {
        EXPECT_LT(residual.row(structure.interface(0).rows[s]).norm(), 5e-3 * before) << stiffness;
      }
    }
  }
}

TEST(Pair, RefusesWhatItCannotSolve) {
  Bars bars{.parts = 2};
  bars.joint_law = "contact";
  EXPECT_THROW(static_cast<void>(bars.build()), latin::InputError);
  bars.paired = false;
  const latin::substructure::Laws laws = bars.build();  // the coarse problem takes any law
  latin::iteration::State state;
  EXPECT_NO_THROW(solved(laws, state));
}

}  // namespace
