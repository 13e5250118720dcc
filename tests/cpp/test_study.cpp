#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <string>

#include "chain.hpp"
#include "latin/latin.hpp"

namespace {

using chain::at;
using latin::Index;
using latin::Matrix;
using latin::Solution;
using latin::SolveOptions;
using latin::Status;
using latin::Study;
using latin::Vector;

constexpr Index bar_nodes = 5;
constexpr double wall_spring = 0.5;
constexpr double bar_push = 0.2;

SolveOptions tight() {
  SolveOptions options;
  options.rtol = 1e-11;
  return options;
}

/// A text that an InputError is to have.
void expect_refused(const std::string& text, const std::function<void()>& call) {
  try {
    call();
    ADD_FAILURE() << "nothing was thrown that says " << text;
  } catch (const latin::InputError& error) {
    EXPECT_NE(std::string(error.what()).find(text), std::string::npos) << error.what();
  }
}

/// Two bars of axial stiffness 1 with springs to walls and a gap between them; the right one is pushed to the left by
/// the first load pattern, the left one to the right by the second.
Study two_bars() {
  const auto bar = [](const std::string& name, double first, double second, Index held) {
    Matrix load = Matrix::Zero(bar_nodes, 2);
    load(bar_nodes - 1, 0) = first;
    load(0, 1) = second;
    return latin::BodyDescription{
        .name = name,
        .size = bar_nodes,
        .members = {{.name = name, .stiffness = chain::shared_bar(bar_nodes), .load = load}},
        .springs = {{.name = name + " spring",
                     .members = {0},
                     .traces = {at(held, bar_nodes)},
                     .stiffness = Vector::Constant(1, wall_spring),
                     .jump = Matrix::Zero(1, 2)}}};
  };
  const auto side = [](const std::string& name, Index node) {
    return latin::SideDescription{.member = name,
                                  .trace = at(node, bar_nodes),
                                  .direction = Vector::Constant(1, wall_spring),
                                  .scale = 1.0};
  };
  const latin::InterfaceDescription contact{
      .name = "contact",
      .law = "contact",
      .weights = Vector::Ones(1),
      .frames = Matrix::Ones(1, 1),
      .sides = {side("left", bar_nodes - 1), side("right", 0)}};
  return Study({bar("left", 0.0, bar_push, 0), bar("right", -bar_push, 0.0, bar_nodes - 1)},
               {contact});
}

/// Springs in series: the gap less what closes it.
double pressed(double gap, double amplitude = 1.0) {
  return std::max(0.0, (amplitude * bar_push / wall_spring - gap) / (2.0 / wall_spring + 2.0));
}

/// A block with unknowns (right, up) on a floor with friction, held by a spring; patterns: weight, and a pull of 1.
Study block_on_floor(double spring, const latin::interface::LawSource& law,
                     double direction = 8.0) {
  latin::SparseRows stiffness(2, 2);
  stiffness.insert(0, 0) = spring;
  stiffness.insert(1, 1) = 0.0;
  stiffness.makeCompressed();
  latin::SparseRows both(2, 2);
  both.setIdentity();
  const latin::BodyDescription block{.name = "block",
                                     .size = 2,
                                     .members = {{.name = "block",
                                                  .stiffness = latin::owning_view(stiffness),
                                                  .load = Matrix{{0.0, 1.0}, {-10.0, 0.0}}}}};
  return Study({block}, {{.name = "floor",
                          .law = law,
                          .weights = Vector::Ones(1),
                          .frames = Matrix{{0.0, -1.0}, {1.0, 0.0}},
                          .sides = {{.member = "block",
                                     .trace = both,
                                     .direction = Vector::Constant(2, direction),
                                     .scale = 2.0}}}});
}

Matrix pulled(const Vector& pull) {
  Matrix amplitudes = Matrix::Ones(2, pull.size());
  amplitudes.row(1) = pull.transpose();
  return amplitudes;
}

/// Coulomb's friction with mu = 0.3 as a law of a user, as long as the surfaces touch; it sticks rigidly.
struct Dry {
  static constexpr const char* name = "dry";
  static constexpr std::array<latin::interface::Parameter, 1> parameters{{{"friction", 0.0}}};
  static constexpr std::size_t memory = 1;
  static void resolve(latin::interface::PointValues jump, latin::interface::PointValues flexibility,
                      const std::array<double, 1>& p, std::array<double, 1>& slip,
                      latin::interface::PointForce force) {
    force[0] = std::min(0.0, jump[0] / flexibility[0]);
    const double bound = -p[0] * force[0];
    force[1] = std::clamp((jump[1] - slip[0]) / flexibility[1], -bound, bound);
    slip[0] = jump[1] - flexibility[1] * force[1];
  }
};

}  // namespace

TEST(Study, two_bars_press_as_springs_in_series_do) {
  const Study study = two_bars().with_loads(Matrix{{1.0}, {0.0}});
  const Solution solution = study.with_parameter("contact", "gap", 0.1).solve(tight());
  EXPECT_TRUE(solution.converged());
  const double force = pressed(0.1);
  EXPECT_NEAR(-solution.force("contact")(0), force, 1e-10 * bar_push);
  EXPECT_NEAR(solution.jump("contact")(0), -0.1, 1e-10);  // the gap is closed
  const Matrix left = solution.displacement("left");
  ASSERT_EQ(left.rows(), bar_nodes);
  EXPECT_NEAR(left(0, 0), -force / wall_spring, 1e-10);
  EXPECT_NEAR(left(bar_nodes - 1, 0), -force / wall_spring - force, 1e-10);
  const auto all = solution.displacements();
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all[0].first, "left");
  EXPECT_EQ(all[0].second, left);
  EXPECT_EQ(all[1].second, solution.displacement("right"));
  EXPECT_EQ(study.parts(), (std::vector<std::string>{"left", "right"}));
  EXPECT_EQ(study.interfaces(), std::vector<std::string>{"contact"});
  EXPECT_TRUE(study.has_first_side("contact"));
}

TEST(Study, a_study_is_a_value) {
  const Study open =
      two_bars().with_loads(Matrix{{1.0}, {0.0}}).with_parameter("contact", "gap", 1.0);
  const Study closed = open.with_parameters({{"contact", "gap", Matrix::Zero(1, 1)}});
  EXPECT_NEAR(open.solve(tight()).force("contact")(0), 0.0, 1e-12);
  EXPECT_NEAR(-closed.solve(tight()).force("contact")(0), pressed(0.0), 1e-11);
}

TEST(Study, columns_are_load_cases_by_themselves) {
  const Matrix amplitudes{{1.0, 2.0, 0.0}, {0.0, 0.0, 0.0}};
  const Solution solution =
      two_bars().with_loads(amplitudes).with_parameter("contact", "gap", 0.1).solve(tight());
  const latin::Field& force = solution.force("contact");
  EXPECT_EQ(force.columns(), 3);
  for (Index column = 0; column < 3; ++column) {
    EXPECT_NEAR(-force(0, 0, column), pressed(0.1, amplitudes(0, column)), 1e-11);
    EXPECT_EQ(solution.status(column), Status::converged);
  }
}

TEST(Study, a_sweep_hands_out_every_point_and_goes_on_from_those_that_are_known) {
  const Study study = two_bars().with_loads(Matrix{{1.0}, {0.0}});
  const latin::Axis gaps{"contact", "gap", {0.0, 0.1, 0.2, 0.5}};
  latin::SweepOptions options;
  options.rtol = 1e-11;
  std::map<Index, latin::State> found;
  EXPECT_EQ(study.sweep(latin::grid({gaps}), options,
                        [&](Index point, const Solution& solution) {
                          EXPECT_NEAR(-solution.force("contact")(0),
                                      pressed(gaps.values[static_cast<std::size_t>(point)]), 1e-11);
                          found[point] = solution.state();
                        }),
            Status::converged);
  EXPECT_EQ(found.size(), 4U);
  found.erase(2);
  options.solved = found;
  std::vector<Index> again;
  const Status ended =
      study.sweep(latin::grid({gaps}), options, [&](Index point, const Solution& solution) {
        again.push_back(point);
        EXPECT_NEAR(-solution.force("contact")(0), pressed(0.2), 1e-11);
      });
  EXPECT_EQ(ended, Status::converged);
  EXPECT_EQ(again, std::vector<Index>{2});
  options.solved.clear();
  Index called = 0;
  const auto ends = [&](Index, const Solution&) {
    ++called;
    throw latin::Interrupted();
  };
  EXPECT_EQ(study.sweep(latin::grid({gaps}), options, ends), Status::interrupted);
  EXPECT_EQ(called, 1);
}

TEST(Study, displacements_of_a_sweep_are_those_under_the_loads_of_the_point) {
  const Study study =
      two_bars().with_loads(Matrix{{1.0}, {0.0}}).with_parameter("contact", "gap", 9.0);
  // what is swept is added to the amplitudes of both patterns
  const latin::Points points{{{"", "pull", Matrix{{0.0}, {1.0}}, Matrix{{0.0, 1.0, 2.0}}, 1}},
                             {0, 1, 2}};
  latin::SweepOptions options;
  options.rtol = 1e-11;
  const Status ended = study.sweep(points, options, [](Index point, const Solution& solution) {
    const double moved = static_cast<double>(point) * bar_push / wall_spring;
    EXPECT_NEAR(solution.displacement("left")(0, 0), moved, 1e-10);
    EXPECT_NEAR(solution.jump("contact")(0), -bar_push / wall_spring - moved, 1e-10);
  });
  EXPECT_EQ(ended, Status::converged);
}

TEST(Study, a_grid_numbers_its_points_with_the_last_axis_fastest) {
  const latin::Points points = latin::grid({{"a", "x", {1.0, 2.0}}, {"b", "y", {5.0, 6.0, 7.0}}});
  EXPECT_EQ(points.parameters[0].values, (Matrix{{1.0, 1.0, 1.0, 2.0, 2.0, 2.0}}));
  EXPECT_EQ(points.parameters[1].values, (Matrix{{5.0, 6.0, 7.0, 5.0, 6.0, 7.0}}));
  EXPECT_EQ(points.order, (std::vector<Index>{0, 1, 2, 5, 4, 3}));
  expect_refused("at least one", [] { static_cast<void>(latin::grid({{"a", "x", {}}})); });
  const std::vector<double> many(4000);
  expect_refused("more than 10000000 points: give fewer",
                 [&] { static_cast<void>(latin::grid({{"a", "x", many}, {"b", "y", many}})); });
}

TEST(Study, a_block_is_pulled_to_and_fro_over_a_floor_with_friction) {
  const Vector pull{{1.0, 2.5, 6.0, 8.0, 5.0, 0.0, -4.0, -8.0, 0.0}};
  const double spring = 2.0;
  for (const latin::interface::LawSource& law :
       {latin::interface::LawSource("coulomb"), latin::interface::law_of<Dry>()}) {
    const Solution solution = block_on_floor(spring, law)
                                  .with_parameter("floor", "friction", 0.3)
                                  .with_history(pulled(pull))
                                  .solve(tight());
    EXPECT_TRUE(solution.converged());
    const Matrix place = solution.displacement("block");
    const latin::Field& force = solution.force("floor");
    double slip =
        0.0;  // it sticks rigidly at its place, until spring and pull leave more than mu W
    for (Index step = 0; step < pull.size(); ++step) {
      double held = pull(step) - spring * slip;
      if (std::abs(held) > 3.0) {
        held = std::copysign(3.0, held);
        slip = (pull(step) - held) / spring;
      }
      EXPECT_NEAR(place(0, step), slip, 1e-9) << step;
      EXPECT_NEAR(force(0, 0, step), -10.0, 1e-8) << step;
      EXPECT_NEAR(force(0, 1, step), -held, 1e-8) << step;
      EXPECT_EQ(force.component(1)(0, step), force(0, 1, step));
    }
  }
}

TEST(Study, a_run_resumes_from_the_state_of_another) {
  const Study study =
      two_bars().with_loads(Matrix{{1.0}, {0.0}}).with_parameter("contact", "gap", 0.1);
  SolveOptions options = tight();
  const Solution whole = study.solve(options);
  options.callback = [](const latin::iteration::Iteration&) { throw latin::Interrupted(); };
  const Solution begun = study.solve(options);
  EXPECT_EQ(begun.status(), Status::interrupted);
  EXPECT_EQ(begun.status(0), Status::interrupted);
  options.callback = {};
  options.start = begun.state();
  EXPECT_NEAR(study.solve(options).force("contact")(0), whole.force("contact")(0), 1e-10);
  options.start = whole.state();
  const Solution again = study.solve(options);
  EXPECT_TRUE(again.converged());
  EXPECT_LE(again.summary().iterations, whole.summary().iterations);
  EXPECT_NEAR(again.force("contact")(0), whole.force("contact")(0), 1e-10);
  expect_refused("a start state has shape (2, 1), this problem needs (2, 3)",
                 [&] { static_cast<void>(study.with_loads(Matrix::Ones(2, 3)).solve(options)); });
}

TEST(Study, the_steps_before_one_without_equilibrium_are_answers) {
  // without a spring nothing holds more than mu W = 3
  const Solution solution = block_on_floor(0.0, "coulomb")
                                .with_parameter("floor", "friction", 0.3)
                                .with_history(pulled(Vector{{1.0, 2.0, 4.0, 1.0}}))
                                .solve({});
  EXPECT_TRUE(solution.status() == Status::no_equilibrium || solution.status() == Status::slides)
      << to_string(solution.status());
  EXPECT_EQ(solution.status(0), Status::converged);
  EXPECT_EQ(solution.status(1), Status::converged);
  EXPECT_EQ(solution.status(2), solution.status());
  EXPECT_EQ(solution.status(3), solution.status());
  EXPECT_NEAR(solution.force("floor")(0, 1, 1), -2.0, 1e-4);
}

TEST(Study, what_does_not_fit_is_named_with_its_value) {
  const Study study = two_bars();
  const Solution solution = study.with_loads(Matrix{{1.0}, {0.0}}).solve();
  expect_refused("no active interface 'joint'; active: contact",
                 [&] { static_cast<void>(solution.force("joint")); });
  expect_refused("there is no part 'middle' here; parts: left, right",
                 [&] { static_cast<void>(solution.displacement("middle")); });
  expect_refused("step 1: give one of 0..0", [&] { static_cast<void>(solution.status(1)); });
  expect_refused("point -1: give one of 0..0",
                 [&] { static_cast<void>(solution.force("contact")(-1)); });
  expect_refused("component 1: give one of 0..0",
                 [&] { static_cast<void>(solution.force("contact")(0, 1)); });
  expect_refused("column 7: give one of 0..0",
                 [&] { static_cast<void>(solution.force("contact")(0, 0, 7)); });
  expect_refused("law 'contact' has no parameter 'friction'",
                 [&] { static_cast<void>(study.with_parameter("contact", "friction", 1.0)); });
  for (const Matrix& amplitudes :
       {Matrix(Matrix::Ones(3, 1)), Matrix(2, 0), Matrix(Matrix::Constant(2, 1, std::nan("")))}) {
    expect_refused("a row for each of the 2 load patterns",
                   [&] { static_cast<void>(study.with_history(amplitudes)); });
  }
  expect_refused("interface 'contact'", [&] {
    static_cast<void>(study.with_parameters({{"contact", "gap", Matrix::Ones(1, 2)}})
                          .with_loads(Matrix::Ones(2, 3))
                          .solve());
  });
  SolveOptions options;
  options.rtol = 2.0;
  expect_refused("rtol is 2", [&] { static_cast<void>(study.solve(options)); });
}

TEST(Study, the_defaults_are_those_of_the_iteration) {
  const latin::iteration::Options given;
  EXPECT_EQ(SolveOptions().rtol, given.rtol);
  EXPECT_EQ(latin::SweepOptions().max_iterations, given.max_iterations);
  EXPECT_EQ(two_bars().with_loads(Matrix::Ones(2, 1)).solve().force("contact").values(),
            two_bars().solve().force("contact").values());
}

TEST(Study, a_summary_says_how_it_ended_in_a_line_and_in_full) {
  const Solution solution = two_bars().solve();
  const std::string brief = solution.summary().brief();
  EXPECT_EQ(brief.rfind("converged after ", 0), 0U) << brief;
  EXPECT_EQ(brief.find('\n'), std::string::npos);
  const std::string full = solution.summary().full();
  EXPECT_EQ(full.rfind(brief + "\n", 0), 0U) << full;
  EXPECT_NE(full.find("\nerrors of group 0: "), std::string::npos) << full;
  latin::Summary unknown;
  unknown.error = std::numeric_limits<double>::infinity();
  EXPECT_EQ(unknown.brief(), "max_iterations after 0 iterations, estimated error not known");
}
