#include <gtest/gtest.h>

#include <string>

#include "chain.hpp"
#include "iteration/batch.hpp"
#include "iteration/sweep.hpp"
#include "latin/common/error.hpp"
#include "stochastic/transform.hpp"

using latin::Index;
using latin::Matrix;
using latin::SparseColumns;
using latin::Vector;
using latin::iteration::advance_together;
using latin::iteration::State;
using latin::iteration::Summary;
using latin::substructure::Laws;

namespace {

Laws with_stiffness(const Laws& laws, const std::string& joint, Matrix values) {
  return laws.with_parameters({{joint, "normal", std::move(values)}});
}

State solved(const Laws& laws, const Matrix& amplitudes) {
  State state;
  latin::iteration::solve(laws, chain::options(), amplitudes, state, {}, {});
  return state;
}

/// Four bars whose first joint has a random stiffness: its columns are three chaos modes.
Laws random_joint() {
  chain::Scene scene;
  scene.parts = 4;
  SparseColumns galerkin(3, 3);
  for (int i = 0; i < 3; ++i) {
    galerkin.insert(i, i) = 2.0;
    if (i > 0) {
      galerkin.insert(i, i - 1) = 0.5;
      galerkin.insert(i - 1, i) = 0.5;
    }
  }
  const auto transform = latin::stochastic::galerkin_transform(galerkin);
  const Matrix values = transform.values.transpose();
  return with_stiffness(scene.build().with_modes(3), "joint1", Matrix::Constant(1, 1, 2.0))
      .with_columns("joint1",
                    {{0, 1, {transform}, {{"normal", latin::interface::ParameterField(values)}}}});
}

const Matrix modes = (Matrix(1, 3) << 1.0, 0.0, 0.0).finished();

}  // namespace

/// Points side by side take the step that each of them takes alone.
TEST(Batch, IsOneIterationOfEveryPoint) {
  chain::Scene scene;
  scene.parts = 4;
  const Laws laws = scene.build();
  const Matrix amplitudes = (Matrix(1, 2) << 1.0, -0.5).finished();
  std::vector<State> known;
  for (const double stiffness : {1.0, 2.0, 5.0}) {
    known.push_back(
        solved(with_stiffness(laws, "joint2", Matrix::Constant(1, 1, stiffness)), amplitudes));
  }
  const std::vector<const State*> snapshots{&known[0], &known[1], &known[2]};
  constexpr Index sets = 4;
  const Vector values = Vector::LinSpaced(sets, 1.2, 4.0);
  Matrix field(1, 2 * sets);
  for (Index set = 0; set < sets; ++set) {
    field.middleCols(2 * set, 2).setConstant(values(set));
  }
  auto options = chain::options();
  options.newton = 0;
  const auto together =
      advance_together(with_stiffness(laws, "joint2", field), options, amplitudes, sets, snapshots);
  options.max_iterations = 1;
  for (Index set = 0; set < sets; ++set) {
    State state;
    const Summary alone =
        latin::iteration::solve(with_stiffness(laws, "joint2", Matrix::Constant(1, 1, values(set))),
                                options, amplitudes, state, snapshots, {});
    const auto& answer = together[static_cast<std::size_t>(set)];
    EXPECT_LT((answer.state.data - state.data).norm(), 1e-10 * state.data.norm());
    EXPECT_LT((answer.state.traces - state.traces).norm(), 1e-10 * state.traces.norm());
    EXPECT_NEAR(answer.residual, alone.history.back().residual, 1e-10);
    EXPECT_NEAR(answer.energy, alone.energy, 1e-9 * alone.energy);
    EXPECT_NEAR(answer.indicator, alone.indicator, 1e-6 * alone.indicator + 1e-12);
    if (std::isfinite(answer.error)) {
      EXPECT_NEAR(answer.error, alone.error, 1e-6 * alone.error + 1e-10);
    }
  }
}

TEST(Batch, RefusesTransformedColumnsByName) {
  const Laws laws = random_joint();
  const State state = solved(laws, modes);
  try {
    advance_together(laws, chain::options(), modes, 2, {&state, &state});
    FAIL() << "not refused";
  } catch (const latin::InputError& error) {
    EXPECT_EQ(std::string(error.what()),
              "interface 'joint1': parameter sets are not solved side by side where columns are "
              "transformed");
  }
}

TEST(Batch, ASweepOverTransformedColumnsSolvesPointAfterPoint) {
  const Laws laws = random_joint();
  const Index points = 20;
  const Vector values = Vector::LinSpaced(points, 1.0, 4.0);
  auto options = chain::options(10, 1e-8);
  options.together = 16;
  Index seen = 0;
  latin::iteration::sweep(
      laws, options, modes, {{"joint2", "normal", Matrix::Ones(1, 1), values.transpose()}},
      latin::iteration::snake_order({points}), {}, {}, {},
      [&](Index point, const Laws& of_point, const Summary& summary, const State& state) {
        EXPECT_EQ(summary.status, latin::iteration::Status::converged);
        const State alone = solved(of_point, modes);
        EXPECT_LT((state.traces - alone.traces).norm(), 1e-6 * alone.traces.norm())
            << "point " << point;
        ++seen;
      });
  EXPECT_EQ(seen, points);
}
