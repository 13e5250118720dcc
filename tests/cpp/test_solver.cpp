#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <numeric>
#include <set>

#include "chain.hpp"
#include "iteration/sweep.hpp"
#include "latin/common/error.hpp"
#include "pushed.hpp"

using latin::Index;
using latin::Matrix;
using latin::Vector;
using latin::iteration::State;
using latin::iteration::Status;

namespace {

latin::iteration::Summary run(const latin::substructure::Laws& laws, State& state,
                              const latin::iteration::Options& options,
                              const latin::iteration::Callback& callback = {}) {
  return latin::iteration::solve(laws, options, Matrix::Ones(1, 1), state, {}, callback);
}

}  // namespace

class Chain : public testing::TestWithParam<double> {};

TEST_P(Chain, MatchesTheSeriesOfSpringsForEveryDirection) {
  for (const double stiffness : {1e-3, 1.0, 1e6}) {
    chain::Scene scene;
    scene.parts = 3;
    scene.stiffness = stiffness;
    scene.jump = 0.1;
    scene.direction = GetParam();
    const latin::substructure::Laws laws = scene.build();
    State state;
    // rounding of the forces, in front of the softest joints: 1e-15 k / 1e-3
    const auto summary = run(laws, state, chain::options(10, GetParam() > 1.0 ? 1e-9 : 1e-10));
    EXPECT_EQ(summary.status, Status::converged)
        << "joints " << stiffness << ", error " << summary.error;
    EXPECT_NEAR(chain::end_displacement(laws, state), scene.exact(), 1e-8 * scene.exact());
  }
}

INSTANTIATE_TEST_SUITE_P(Directions, Chain, testing::Values(1e-2, 1.0, 1e2));

TEST(Solver, PlainIterationReachesTheSameAnswer) {
  const chain::Scene scene;
  const latin::substructure::Laws laws = scene.build();
  State state;
  const auto summary = run(laws, state, chain::options(0));
  EXPECT_EQ(summary.status, Status::converged);
  EXPECT_NEAR(chain::end_displacement(laws, state), scene.exact(), 1e-9 * scene.exact());
}

TEST(Solver, EstimateIsCloseToTheErrorOfThePlainIteration) {
  const chain::Scene scene;
  const latin::substructure::Laws laws = scene.build();
  State exact;
  run(laws, exact, chain::options(10, 1e-14));
  for (const double rtol : {1e-2, 1e-4, 1e-6}) {
    State state;
    const auto summary = run(laws, state, chain::options(0, rtol));
    const latin::substructure::Structure& structure = laws.structure();
    latin::substructure::Yardstick yardstick = latin::substructure::yardstick(structure, {});
    const auto whole =
        latin::substructure::GlobalStage(laws).sizes(exact.data, exact.traces, Matrix::Ones(1, 1));
    yardstick.reach = yardstick.share_of_reach(whole);
    const double truth =
        yardstick
            .relative(latin::substructure::sizes_of_distance(
                          structure, {}, state.data, state.traces, exact.data, exact.traces),
                      whole)
            .maxCoeff();
    EXPECT_GT(summary.error, truth / 3.0);
    EXPECT_LT(summary.error, truth * 3.0);
  }
}

TEST(Solver, SaysWhenItDidNotConverge) {
  // pulled off its contact: there is no answer
  const latin::substructure::Laws laws = chain::Pushed{.force = 1.0}.build();
  State state;
  const auto summary = run(laws, state, chain::options());
  EXPECT_NE(summary.status, Status::converged);
  EXPECT_GT(summary.error, 1e-10);
  auto options = chain::options(0);
  options.max_iterations = 3;
  State other;
  EXPECT_EQ(run(laws, other, options).status, Status::max_iterations);
}

TEST(Solver, FinishesWhatCreepsOnTheAssembledStructure) {
  chain::Scene scene;
  scene.stiffness = 1e6;  // far from k: the plain iteration creeps
  const latin::substructure::Laws laws = scene.build();
  auto options = chain::options(0);
  for (const Index most : {50, 5000}) {
    options.max_iterations = most;
    State state;
    EXPECT_EQ(run(laws, state, options).status, Status::converged);
    EXPECT_NEAR(chain::end_displacement(laws, state), scene.exact(), 1e-9 * scene.exact());
  }
}

TEST(Solver, ZeroLoadIsSolvedAtOnce) {
  chain::Scene scene;
  scene.force = 0.0;
  const latin::substructure::Laws laws = scene.build();
  State state;
  const auto summary = run(laws, state, chain::options());
  EXPECT_EQ(summary.status, Status::converged);
  EXPECT_EQ(chain::end_displacement(laws, state), 0.0);
}

TEST(Solver, NanEndsTheRunAsDiverged) {
  const latin::substructure::Laws laws = chain::Scene{}.build();
  State state;
  const Matrix lost = Matrix::Constant(1, 1, std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(latin::iteration::solve(laws, chain::options(), lost, state, {}, {}).status,
            Status::undecided);
}

TEST(Solver, CallbackSeesEveryIterationAndMayStopTheRun) {
  const chain::Scene scene;
  const latin::substructure::Laws laws = scene.build();
  State state;
  std::vector<Index> seen;
  const auto summary = run(
      laws, state, chain::options(),
      [&seen](const latin::iteration::Iteration& iteration) { seen.push_back(iteration.number); });
  // in between are the stages of checks
  EXPECT_EQ(seen.size(), summary.history.size());
  EXPECT_TRUE(std::ranges::is_sorted(seen, std::ranges::less_equal{}));
  EXPECT_EQ(seen.front(), 1);
  EXPECT_EQ(seen.back(), summary.iterations);
  State stopped;
  EXPECT_THROW(run(laws, stopped, chain::options(),
                   [](const latin::iteration::Iteration&) { throw std::runtime_error("stop"); }),
               std::runtime_error);
}

TEST(Solver, CallbackMayAskForWhatIsDoneSoFar) {
  const chain::Scene scene;
  const latin::substructure::Laws laws = scene.build();
  auto options = chain::options(0);
  options.rtol = 1e-14;
  State state;
  const auto summary = run(laws, state, options, [](const latin::iteration::Iteration& iteration) {
    if (iteration.number == 3) {
      throw latin::Interrupted();
    }
  });
  EXPECT_EQ(summary.status, Status::interrupted);
  EXPECT_EQ(summary.iterations, 3);
  options.max_iterations = 3;
  options.stop_on_indicator = true;  // nothing is tried beyond the iterations
  State other;
  run(laws, other, options);
  EXPECT_EQ(state.data, other.data);
  EXPECT_EQ(to_string(summary.status), "interrupted");
}

TEST(Solver, ColumnsAreIndependentRightHandSides) {
  const chain::Scene scene;
  const latin::substructure::Laws laws = scene.build();
  const Matrix amplitudes = (Matrix(1, 3) << 1.0, 0.0, -2.0).finished();
  State state;
  const auto summary = latin::iteration::solve(laws, chain::options(), amplitudes, state, {}, {});
  EXPECT_EQ(summary.status, Status::converged);
  const auto fields = latin::substructure::displacements(laws, state.data, amplitudes);
  for (Index column = 0; column < 3; ++column) {
    EXPECT_NEAR(fields.back().second(4, column), amplitudes(0, column) * scene.exact(), 1e-8);
  }
}

TEST(Solver, RefusesOptionsOutOfRange) {
  const chain::Scene scene;
  const latin::substructure::Laws laws = scene.build();
  for (const auto& change : std::vector<std::function<void(latin::iteration::Options&)>>{
           [](auto& o) { o.rtol = 0.0; }, [](auto& o) { o.max_iterations = 0; },
           [](auto& o) { o.acceleration = -1; }, [](auto& o) { o.relaxation = 1.5; }}) {
    auto options = chain::options();
    change(options);
    State state;
    EXPECT_THROW(run(laws, state, options), latin::InputError);
  }
  State wrong{Matrix::Zero(1, 1), Matrix::Zero(1, 1)};
  EXPECT_THROW(run(laws, wrong, chain::options()), latin::InputError);
}

TEST(Sweep, EveryPointMatchesAndLaterPointsAreCheap) {
  chain::Scene scene;
  scene.parts = 4;
  const latin::substructure::Laws laws = scene.build();
  const Index points = 12;
  const Vector values = Vector::LinSpaced(points, 0.5, 5.0);
  std::vector<latin::iteration::SweptParameter> swept;
  for (int joint = 1; joint < 4; ++joint) {
    swept.push_back(
        {"joint" + std::to_string(joint), "normal", Matrix::Ones(1, 1), values.transpose()});
  }
  std::vector<Index> iterations(points);
  latin::iteration::sweep(laws, chain::options(), Matrix::Ones(1, 1), swept,
                          latin::iteration::snake_order({points}), {}, {}, {},
                          [&](Index point, const latin::substructure::Laws& of_point,
                              const latin::iteration::Summary& summary, const State& state) {
                            EXPECT_EQ(of_point.parameter("joint1", "normal")(0, 0), values(point));
                            EXPECT_EQ(summary.status, Status::converged);
                            iterations[static_cast<std::size_t>(point)] = summary.iterations;
                            chain::Scene exact = scene;
                            exact.stiffness = values(point);
                            EXPECT_NEAR(chain::end_displacement(laws, state), exact.exact(), 1e-7);
                          });
  EXPECT_LT(std::accumulate(iterations.begin() + 1, iterations.end(), Index{0}),
            (points - 1) * iterations[0]);
}

/// A share starts from what was known after the first points, whatever has been solved since.
TEST(Sweep, SharesAreTheSameInAnyOrder) {
  chain::Scene scene;
  scene.parts = 4;
  const latin::substructure::Laws laws = scene.build();
  const Index points = 12;
  const Vector values = Vector::LinSpaced(points, 0.5, 5.0);
  std::vector<latin::iteration::SweptParameter> swept;
  for (int joint = 1; joint < 4; ++joint) {
    swept.push_back(
        {"joint" + std::to_string(joint), "normal", Matrix::Ones(1, 1), values.transpose()});
  }
  const auto states = [&](const std::vector<std::vector<Index>>& shares) {
    std::vector<Matrix> found(points);
    std::size_t number = 0;
    latin::iteration::sweep(
        laws, chain::options(), Matrix::Ones(1, 1), swept, {2, 8}, {}, {}, {},
        [&](Index point, const latin::substructure::Laws&, const latin::iteration::Summary& summary,
            const State& state) {
          EXPECT_EQ(summary.status, Status::converged);
          chain::Scene exact = scene;
          exact.stiffness = values(point);
          EXPECT_NEAR(chain::end_displacement(laws, state), exact.exact(), 1e-7);
          found[static_cast<std::size_t>(point)] = state.data;
        },
        [&] { return number < shares.size() ? shares[number++] : std::vector<Index>{}; });
    return found;
  };
  const auto one = states({{0, 1, 3, 4, 5}, {6, 7}, {9, 10, 11}});
  const auto other = states({{9, 10, 11}, {0, 1, 3, 4, 5}, {6, 7}});
  for (std::size_t point = 0; point < one.size(); ++point) {
    ASSERT_GT(one[point].size(), 0) << point;
    EXPECT_LT((one[point] - other[point]).norm(), 1e-12 * one[point].norm()) << point;
  }
}

TEST(Sweep, StartsFromStatesOfAnEarlierRun) {
  const chain::Scene scene;
  const latin::substructure::Laws laws = scene.build();
  State state;
  run(laws, state, chain::options());
  const std::vector<latin::iteration::SweptParameter> swept{
      {"joint1", "normal", Matrix::Ones(1, 1), Matrix::Constant(1, 1, scene.stiffness)}};
  latin::iteration::sweep(
      laws, chain::options(10, 1e-8), Matrix::Ones(1, 1), swept, {0}, {state}, {0}, {},
      [](Index, const latin::substructure::Laws&, const latin::iteration::Summary& summary,
         const State&) { EXPECT_LE(summary.iterations, 3); });
}

TEST(SnakeOrder, VisitsAllPointsInSingleSteps) {
  const std::vector<Index> shape{3, 4, 5};
  const auto order = latin::iteration::snake_order(shape);
  EXPECT_EQ(std::set<Index>(order.begin(), order.end()).size(), 60U);
  for (std::size_t i = 1; i < order.size(); ++i) {
    Index a = order[i - 1];
    Index b = order[i];
    Index steps = 0;
    for (auto axis = shape.rbegin(); axis != shape.rend(); ++axis) {
      steps += std::abs(a % *axis - b % *axis);
      a /= *axis;
      b /= *axis;
    }
    EXPECT_EQ(steps, 1) << "from position " << i - 1;
  }
  EXPECT_THROW(static_cast<void>(latin::iteration::snake_order({3, 0})), latin::InputError);
}
