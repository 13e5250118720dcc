#include "iteration/newton.hpp"

#include <gtest/gtest.h>

#include "bars.hpp"
#include "iteration/krylov.hpp"
#include "pushed.hpp"

namespace latin::iteration {
namespace {

/// Three bars one on another, pressed onto a wall more in each step.
substructure::Laws pressed(Index steps) {
  const Vector rising = Vector::LinSpaced(steps, -1.0, -2.0);
  return chain::Bars{.parts = 3, .macro = false, .paired = false, .joint_law = "coulomb"}
      .build()
      .with_steps(steps)
      .with_parameters({{"pull", "force", rising.transpose()}});
}

State zero(const substructure::Laws& laws, Index steps) {
  const Matrix none = Matrix::Zero(laws.structure().rows(), steps);
  return {none, none};
}

/// The end of three bars of unit stiffness moves by three times the force.
double end(const substructure::Laws& laws, const State& state, Index step) {
  const auto fields =
      substructure::displacements(laws, state.data, Matrix::Ones(1, state.data.cols()));
  const Matrix& last = fields.back().second;
  return last(last.rows() - 1, step);
}

struct Count {
  Index asked;
  Index factorisations;
};

Count count(Index steps) {
  const substructure::Laws laws = pressed(steps);
  const Matrix amplitudes = Matrix::Ones(1, steps);
  substructure::GlobalStage global(laws);
  Newton newton(global, amplitudes);
  State state = zero(laws, steps);
  EXPECT_EQ(newton.solve(state, 1e-10, steps).solved, steps);
  // on springs mu k, whose forces the outer iteration would take back
  const double held = 6.0 * substructure::Flexibility::mu;
  EXPECT_NEAR(end(laws, state, 0), -3.0, 3.0 * held);
  EXPECT_NEAR(end(laws, state, steps - 1), -6.0, 6.0 * held);
  return {newton.system().asked(), newton.skeleton().factorisations()};
}

}  // namespace

TEST(Newton, CostOfAHistoryIsLinearInItsSteps) {
  if (!pressed(1).structure().has_flexibility()) {
    GTEST_SKIP() << "the backend does not condense";
  }
  const Count few = count(10);
  const Count many = count(40);
  EXPECT_LE(many.asked, 4 * few.asked + few.asked / 2);
  EXPECT_LE(many.factorisations, 4 * few.factorisations);  // of which one is kept
}

TEST(Newton, MarchesWithTheFlexibilityOfTheBodiesOrWithTheirWholeStiffness) {
  const chain::Sliding scene{.count = 2, .whole = true};
  const Index steps = 4;
  const substructure::Laws laws = scene.build().with_steps(steps);
  // pushed: it sticks, slips, slips back, sticks
  const Matrix loads = (Matrix(2, steps) << 1.0, 1.0, 1.0, 1.0, 0.2, 1.0, 0.2, 0.4).finished();
  const Vector slipped = scene.compliance() * Vector{{0.0, 0.7, 0.5, 0.5}};
  substructure::GlobalStage global(laws);
  for (const bool dense : {true, false}) {
    Newton newton(global, loads, dense);
    State state = zero(laws, steps);
    global.apply(state.data, loads, state.traces);
    EXPECT_EQ(newton.solve(state, 1e-10, steps).solved, steps) << dense;
    EXPECT_LT((state.traces.row(1).transpose() - slipped).norm(), 1e-6) << dense;
  }
}

TEST(Gmres, SolvesARankOneChangeInTwoProducts) {
  const Index n = 20;
  const Vector b = Vector::LinSpaced(n, 1.0, 2.0);
  const Vector u = Vector::LinSpaced(n, -1.0, 3.0);
  const auto apply = [&](const Vector& x) { return Vector(x + u * x.sum()); };
  const auto none = [](const Vector& x) { return x; };
  Vector x;
  const KrylovOutcome outcome = gmres(apply, none, b, x, 1e-12, 10);
  EXPECT_TRUE(outcome.solved);
  EXPECT_EQ(outcome.products, 2);
  EXPECT_LT((apply(x) - b).norm(), 1e-11 * b.norm());
  EXPECT_TRUE(gmres(apply, none, Vector::Zero(n), x, 1e-12, 10).solved);
  EXPECT_TRUE(x.isZero(0.0));
}

}  // namespace latin::iteration
