#include <gtest/gtest.h>

#include "bars.hpp"

namespace {

using chain::Bars;
using chain::solved;
using latin::Index;
using latin::Matrix;

TEST(Macro, NumberOfPartsDoesNotMatter) {
  for (const char* law : {"elastic", "perfect"}) {
    for (const Index parts : {2, 8, 64, 512}) {
      const Bars bars{.parts = parts, .joint_law = law};
      const latin::substructure::Laws laws = bars.build();
      latin::iteration::State state;
      const latin::iteration::Summary summary = solved(laws, state);
      EXPECT_EQ(summary.status, latin::iteration::Status::converged);
      // one moment is all that a bar has: the coarse problem is the whole problem
      EXPECT_LE(summary.iterations, 8) << law << ", " << parts << " parts";
      EXPECT_NEAR(chain::end_displacement(laws, state), bars.exact(), 1e-5 * bars.exact());
      EXPECT_EQ(laws.structure().macro_size(), parts);
    }
  }
}

TEST(Macro, EachIsOfUseAlone) {
  const auto iterations = [](bool macro, bool paired) {
    const Bars bars{.parts = 16, .macro = macro, .paired = paired};
    const latin::substructure::Laws laws = bars.build();
    latin::iteration::State state;
    // by the indicator: checks would finish what creeps
    latin::iteration::Options options = chain::options(10, 1e-9);
    options.stop_on_indicator = true;
    const latin::iteration::Summary summary =
        latin::iteration::solve(laws, options, Matrix::Ones(1, 1), state, {}, {});
    if (summary.status == latin::iteration::Status::converged) {
      EXPECT_NEAR(chain::end_displacement(laws, state), bars.exact(), 1e-4 * bars.exact());
    }
    return summary.iterations;
  };
  const Index neither = iterations(false, false);
  const Index both = iterations(true, true);
  EXPECT_LT(iterations(false, true), neither);
  EXPECT_LT(iterations(true, false), neither / 2);
  EXPECT_LT(both, neither / 4);
}

TEST(Macro, BalancesForcesAndIsAProjection) {
  const Bars bars{.parts = 6};
  const latin::substructure::Laws laws = bars.build();
  const latin::substructure::Structure& structure = laws.structure();
  latin::substructure::GlobalStage global(laws);
  latin::substructure::LocalStage local(laws, 3);
  Matrix data(structure.rows(), 3);
  for (Index i = 0; i < data.size(); ++i) {
    data.data()[i] = std::sin(1.0 + 2.3 * static_cast<double>(i));
  }
  const Matrix none = Matrix::Zero(structure.loads(), 3);
  Matrix traces(structure.rows(), 3);
  global.apply(data, none, traces);
  ASSERT_EQ(structure.macro_size(), 6);
  static_cast<void>(global.balance(global.imbalance(local, data, traces), none, data, traces));
  // traces are those of the data
  Matrix again(structure.rows(), 3);
  global.apply(data, none, again);
  EXPECT_LT((again - traces).norm(), 1e-12 * traces.norm());
  const Matrix forces = data - structure.directions().asDiagonal() * traces;
  for (std::size_t i = 0; i + 2 < structure.interfaces().size(); ++i) {
    const auto sum =
        forces.row(structure.interface(i).rows[0]) + forces.row(structure.interface(i).rows[1]);
    EXPECT_LT(sum.norm(), 1e-11 * forces.norm());
  }
  const auto pull = forces.row(structure.interface(structure.find_interface("pull")).rows[0]);
  EXPECT_LT((pull.array() - Bars::force).abs().maxCoeff(), 1e-10);
  EXPECT_LT(global.balance(global.imbalance(local, data, traces), none, data, traces).norm(),
            1e-11 * data.norm());
}

TEST(Macro, AnswerDoesNotDependOnTheDirection) {
  for (const double direction : {1e-2, 1.0, 1e2}) {
    const Bars bars{.parts = 12, .direction = direction};
    const latin::substructure::Laws laws = bars.build();
    latin::iteration::State state;
    EXPECT_EQ(solved(laws, state, 10, 1e-10).status, latin::iteration::Status::converged);
    EXPECT_NEAR(chain::end_displacement(laws, state), bars.exact(), 1e-8 * bars.exact());
  }
}

}  // namespace
