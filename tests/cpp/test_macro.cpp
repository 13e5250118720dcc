#include <gtest/gtest.h>

#include "chain.hpp"
#include "latin/common/error.hpp"

namespace {

using latin::Index;
using latin::Matrix;
using latin::Vector;

/// Bars end to end, held at the left and pulled at the right, both by interfaces: no spring outlasts the
/// iteration, so that only the coarse problem tells one end what happens at the other.
struct Bars {
  Index parts = 8;
  bool macro = true;
  bool paired = true;
  double stiffness = 3.0;  ///< of every joint; infinite: perfect
  double direction = 1.3;
  std::string joint_law = "elastic";
  latin::substructure::OperatorKind kind = latin::substructure::OperatorKind::automatic;

  static constexpr Index nodes = 5;
  static constexpr double force = 2.0;

  [[nodiscard]] latin::substructure::Laws build() const {
    std::vector<latin::substructure::BodyDescription> bodies;
    std::vector<latin::substructure::InterfaceDescription> interfaces;
    const auto side = [this](Index part, Index node, double factor = 1.0) {
      return latin::substructure::SideDescription{"bar" + std::to_string(part),
                                                  chain::at(node, nodes),
                                                  Vector::Constant(1, factor * direction), 1.0};
    };
    const Matrix one = Matrix::Ones(1, 1);
    const Vector area = Vector::Ones(1);
    const Matrix basis = macro ? one : Matrix{};
    for (Index part = 0; part < parts; ++part) {
      const std::string name = "bar" + std::to_string(part);
      bodies.push_back(
          {name, nodes, {{name, chain::shared_bar(nodes), {}, Matrix::Zero(nodes, 1), {}}}, {}});
      if (part > 0) {
        interfaces.push_back({"joint" + std::to_string(part),
                              joint_law,
                              area,
                              one,
                              {side(part - 1, nodes - 1), side(part, 0)},
                              basis,
                              paired});
      }
    }
    const double far = paired ? 1e3 : 1.0;
    interfaces.push_back({"wall", "perfect", area, one, {side(0, 0, far)}, {}, paired});
    interfaces.push_back(
        {"pull", "force", area, one, {side(parts - 1, nodes - 1, 1.0 / far)}, basis, paired});
    latin::substructure::OperatorOptions options;
    options.kind = kind;
    std::vector<latin::substructure::LawParameter> parameters{
        {"pull", "force", Matrix::Constant(1, 1, force)}};
    for (Index part = 1; part < parts && joint_law == "elastic"; ++part) {
      parameters.push_back(
          {"joint" + std::to_string(part), "normal", Matrix::Constant(1, 1, stiffness)});
    }
    return latin::substructure::Laws(std::make_shared<const latin::substructure::Structure>(
                                         std::move(bodies), std::move(interfaces), options))
        .with_parameters(parameters);
  }

  /// Bars and springs in series.
  [[nodiscard]] double exact() const {
    const double joints = joint_law == "elastic" ? static_cast<double>(parts - 1) / stiffness : 0.0;
    return force * (static_cast<double>(parts) + joints);
  }
};

latin::iteration::Summary solved(const latin::substructure::Laws& laws,
                                 latin::iteration::State& state, Index acceleration = 10,
                                 double rtol = 1e-6) {
  latin::iteration::Options options = chain::options(acceleration, rtol);
  options.max_iterations = 300;
  return latin::iteration::solve(laws, options, Matrix::Ones(1, 1), state, {}, {});
}

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
    const latin::iteration::Summary summary = solved(laws, state);
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
  static_cast<void>(global.balance(local, data, traces));
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
  EXPECT_LT(global.balance(local, data, traces).norm(), 1e-11 * data.norm());
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
