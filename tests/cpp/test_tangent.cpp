#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

#include "bars.hpp"
#include "latin/common/error.hpp"
#include "pushed.hpp"
#include "substructure/interface_system.hpp"
#include "substructure/tangent.hpp"

namespace latin::substructure {
namespace {

Matrix slopes_at(const Laws& laws, const iteration::State& state) {
  const InterfaceSystem system(laws);
  const Matrix jumps = system.free_jumps(state.data, state.traces);
  return system.slopes(0, system.blank(), jumps.col(0), system.direct());
}

/// The unknown that alone holds a chain.
Index wall_of(const Laws& laws, const Tangent& tangent) {
  for (const Joined::JoinedInterface& each : tangent.joined().interfaces()) {
    if (each.rows.size() == 1) {
      return each.first_unknown;
    }
  }
  throw std::logic_error(laws.structure().interfaces().front().name());
}

/// One step with the tangents of where we are. @return what it is said to do to the traces
Matrix step(chain::Evaluated& at, double hold = 0.0) {
  const Laws& laws = at.stages.laws();
  Tangent tangent(laws.structure());
  tangent.factorise(slopes_at(laws, at.state), hold);
  Matrix moved(at.residual.rows(), at.residual.cols());
  tangent.correct(at.residual, moved);
  at.state.data += at.residual;
  at.evaluate();
  return moved;
}

}  // namespace

class TangentOfChains : public testing::TestWithParam<std::tuple<Index, double>> {};

/// Rigid laws are taken to be 1e-5 softer than they are: a step leaves as much, and the last nothing.
TEST_P(TangentOfChains, AFewStepsSolveThemToRounding) {
  const auto [parts, direction] = GetParam();
  const chain::Scene scene{.parts = parts, .jump = 0.1, .direction = direction};
  const Laws laws = scene.build();
  const Matrix one = Matrix::Ones(1, 1);
  ASSERT_TRUE(Tangent::possible(laws.structure()));
  chain::Evaluated at(laws, one);
  const double first = at.norm();
  step(at);
  // k is up to 100 times off the stiffness of the bars
  EXPECT_LT(at.norm(), 1e-5 * 1e3 * first);
  for (int i = 0; i < 4; ++i) {
    step(at);
  }
  EXPECT_NEAR(chain::end_displacement(laws, at.state), scene.exact(), 1e-11 * scene.exact());
}

// two bars make a dense matrix, ten a sparse one
INSTANTIATE_TEST_SUITE_P(Sizes, TangentOfChains,
                         testing::Combine(testing::Values(2, 10), testing::Values(1e-2, 1.0, 1e2)));

/// Their tangents are theirs but for 1e-3, and the wall is 1e3 times stiffer: one step finds what they give way.
TEST(Tangent, StiffSpringsKeepTheirStiffness) {
  for (const double stiffness : {3e3, 1e4, 3e4}) {
    const chain::Scene scene{.parts = 4, .stiffness = stiffness};
    const Laws laws = scene.build();
    chain::Evaluated at(laws, Matrix::Ones(1, 1));
    step(at);
    const double given_way = 3.0 * scene.force / stiffness;
    EXPECT_NEAR(chain::end_displacement(laws, at.state), scene.exact(), 5e-3 * given_way)
        << stiffness;
  }
}

TEST(Tangent, KnowsWhatItsStepDoesToTheTraces) {
  const Laws laws = chain::Scene{.parts = 4}.build();
  chain::Evaluated at(laws, Matrix::Ones(1, 3), Matrix::Random(7, 3));
  for (const double hold : {0.0, 0.3, 1.0, 5.0}) {
    const Matrix before = at.state.traces;
    const Matrix moved = step(at, hold);
    // a wall that is 1e-5 softer than rigid loses five digits of its displacement
    EXPECT_LT((at.state.traces - before - moved).norm(), 1e-8 * moved.norm() + 1e-13) << hold;
  }
}

TEST(Tangent, ReachesTheSameAnswerWithBodiesHeldOnlyLater) {
  const chain::Scene scene{.parts = 3};
  const Laws laws = scene.build();
  chain::Evaluated at(laws, Matrix::Ones(1, 1));
  double before = at.norm();
  const double first = before;
  Index steps = 0;
  for (; at.norm() > 1e-10 * first && steps < 500; ++steps) {
    step(at, 1.0);
    EXPECT_LT(at.norm(), before);
    before = at.norm();
  }
  EXPECT_GT(steps, 2);
  EXPECT_NEAR(chain::end_displacement(laws, at.state), scene.exact(), 1e-7 * scene.exact());
}

TEST(Tangent, WithoutInterfacesAndHeldByTheDirectionItIsTheAveragedStep) {
  const Laws laws = chain::Scene{.parts = 3}.build();
  chain::Evaluated at(laws, Matrix::Ones(1, 1));
  Tangent tangent(laws.structure());
  tangent.factorise(Matrix::Zero(3, 1), 1.0);
  Matrix correction = at.residual;
  Matrix moved(5, 1);
  tangent.correct(correction, moved);
  EXPECT_LT((correction - 0.5 * at.residual).norm(), 1e-14 * at.residual.norm());
}

TEST(Tangent, ABodyInFlightMovesAsFarAsItsSpringsLetIt) {
  const chain::Pushed scene{.gap = 1e9};
  const Laws laws = scene.build();
  for (const double hold : {1.0, 1e-3, 1e-6}) {
    chain::Evaluated at(laws, Matrix::Ones(1, 1));
    const double before = at.state.traces(2);
    EXPECT_NEAR(before, scene.force / scene.direction,
                1e-12);  // on the springs of the global stage
    const Matrix moved = step(at, hold);
    const double exact = scene.force / (hold * scene.direction);
    EXPECT_NEAR(moved(2), exact, 1e-9 * std::abs(exact)) << hold;
  }
}

TEST(Tangent, ContactThatClosesIsStiff) {
  const chain::Pushed scene;
  const Laws laws = scene.build();
  chain::Evaluated at(laws, Matrix::Ones(1, 1));
  ASSERT_LT(InterfaceSystem(laws).free_jumps(at.state.data, at.state.traces)(1), 0.0);
  const Matrix slopes = slopes_at(laws, at.state);
  EXPECT_NEAR(slopes(1, 0), scene.direction / 2.0, 1e-12);
  for (int i = 0; i < 4; ++i) {
    step(at);
  }
  EXPECT_LT((at.state.traces - scene.exact()).norm(), 1e-11 * scene.exact().norm());
}

/// Slip pulls by the friction of a pressure that the same step has to find.
TEST(Tangent, FrictionCouplesOneWay) {
  // one block makes a dense matrix, six a sparse one
  for (const Index count : {1, 6}) {
    const chain::Sliding scene{.count = count};
    const Laws laws = scene.build();
    const Matrix loads = (Matrix(2, 1) << 1.0, 0.8).finished();
    chain::Evaluated at(laws, loads);
    step(at);
    step(at);
    for (Index i = 0; i < count; ++i) {
      const auto block = at.state.traces.middleRows(4 * i, 4);
      const double slipped = (0.8 - 0.3) * scene.compliance();
      EXPECT_LT((block - Matrix(Vector{{0.0, slipped, 0.0, 0.5 / scene.spring}})).norm(), 1e-10);
    }
  }
}

TEST(Tangent, IsMadeAnewOnlyForOtherTangents) {
  const chain::Pushed scene;
  const Laws laws = scene.build();
  chain::Evaluated at(laws, Matrix::Ones(1, 1));
  const Matrix closed = slopes_at(laws, at.state);
  Matrix open = closed;
  open(1, 0) = 0.0;
  Tangent tangent(laws.structure());
  const auto correction = [&](const Matrix& slopes) {
    tangent.factorise(slopes, 0.1);
    Matrix residual = at.residual;
    Matrix moved(residual.rows(), 1);
    tangent.correct(residual, moved);
    return residual;
  };
  const Matrix first = correction(closed);
  EXPECT_GT((correction(open) - first).norm(), 1e-3 * first.norm());
  EXPECT_EQ(correction(closed), first);
  EXPECT_EQ(correction(closed * (1.0 + 1e-9)), first);  // differences know no better
}

TEST(Tangent, IsNotPossibleWithoutInterfaces) {
  EXPECT_TRUE(Tangent::possible(chain::Bars{}.build().structure()));
  const Structure alone(
      {{"bar",
        4,
        {{"bar", chain::shared_bar(4), {}, chain::end_load(4, 1.0), {}}},
        {{"spring", {0}, {chain::at(0, 4)}, Vector::Ones(1), Matrix::Zero(1, 1)}}}},
      {}, {});
  EXPECT_FALSE(Tangent::possible(alone));
}

TEST(Joined, OnOneRankItIsTheStructure) {
  const Laws laws = chain::Bars{}.build();
  const substructure::Structure& structure = laws.structure();
  const substructure::Joined joined(structure);
  EXPECT_EQ(joined.rows(), structure.rows());
  EXPECT_EQ(joined.unknowns(), structure.interface_unknowns());
  EXPECT_EQ(joined.active(), structure.active_unknowns());
  EXPECT_EQ(joined.bodies().size(), structure.bodies().size());
  EXPECT_EQ(joined.first_body(), 0);
  EXPECT_EQ(joined.first_row(), 0);
  for (std::size_t i = 0; i < structure.interfaces().size(); ++i) {
    EXPECT_EQ(joined.interfaces()[i].rows, structure.interface(i).rows);
    EXPECT_EQ(joined.interfaces()[i].first_unknown, structure.interface(i).first_unknown);
  }
  const Matrix table = Matrix::Random(structure.rows(), 2);
  EXPECT_EQ(joined.of_rows(table), table);
}

TEST(Tangent, SharesTheStructureOfAnother) {
  const Laws laws = chain::Bars{}.build();
  const Tangent first(laws.structure());
  const Tangent second(laws.structure(), first.shared_joined());
  EXPECT_EQ(&first.joined(), &second.joined());
}

/// A chain that nothing holds: refused or answered alike, whether the matrix is dense or sparse.
TEST(Tangent, ADenseMatrixIsAsStableAsASparseOne) {
  for (const Index parts : {2, 10}) {
    const Laws laws = chain::Scene{.parts = parts}.build();
    Tangent tangent(laws.structure());
    const Index unknowns = tangent.flexibility().size();
    const auto slopes_of = [&](const Vector& stiffness) {
      return Matrix((stiffness.cwiseInverse() + tangent.flexibility()).cwiseInverse());
    };
    const Vector springs = Vector::Ones(unknowns);
    tangent.factorise(slopes_of(springs), 0.0);
    EXPECT_TRUE(tangent.symmetric()) << parts;
    for (const double held : {0.0, 1e-15}) {  // the wall is the last interface: below rounding
      Vector loose = springs;
      loose(wall_of(laws, tangent)) = held;
      try {
        tangent.factorise(slopes_of(loose), 0.0);
        EXPECT_FALSE(tangent.symmetric()) << parts;  // no Cholesky factor is believed
      } catch (const NumericalError&) {
        SUCCEED();
      }
    }
    const double nan = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(tangent.factorise(Matrix::Constant(unknowns, 1, nan), 0.0), NumericalError)
        << parts;
  }
}

}  // namespace latin::substructure
