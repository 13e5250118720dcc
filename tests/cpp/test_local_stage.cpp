#include <gtest/gtest.h>

#include <array>

#include "chain.hpp"
#include "latin/common/error.hpp"

namespace latin::substructure {

TEST(LocalStage, HoldsTheLawAndTheDirections) {
  const Laws laws = chain::Scene{.jump = 0.4}.build();
  const Structure& structure = laws.structure();
  LocalStage local(laws, 3);
  Matrix data(3, 3);
  Matrix traces(3, 3);
  for (Index i = 0; i < 9; ++i) {
    data.data()[i] = std::sin(1.0 + static_cast<double>(i));
    traces.data()[i] = std::cos(0.3 * static_cast<double>(i));
  }
  const std::size_t joint = structure.find_interface("joint1");
  const LocalFields fields = local.fields(joint, data, traces);
  EXPECT_LT((fields.force - 3.0 * (fields.jump.array() - 0.4).matrix()).norm(), 1e-14);
  // r = 2 (f^ - s + k w) on side 1, with -f^ on side 2
  Matrix residual(3, 3);
  local.apply(data, traces, residual);
  for (const std::size_t side : {0, 1}) {
    const Index row = structure.interface(joint).rows[side];
    const double sign = side == 0 ? 1.0 : -1.0;
    EXPECT_LT(
        (residual.row(row) - 2.0 * (sign * fields.force - data.row(row) + 1.3 * traces.row(row)))
            .norm(),
        1e-14);
  }
  const Matrix force = local.force(joint, data, traces);
  EXPECT_EQ(force, fields.force);
}

TEST(LocalStage, TransformsColumnsThereAndBack) {
  const Laws plain = chain::Scene{}.build();
  const double root = std::sqrt(0.5);
  const Matrix turn = (Matrix(2, 2) << root, root, -root, root).finished();
  LawColumns group{0, 1, {{turn, turn.transpose(), {}, {}, {}}}, {}};
  Matrix data = Matrix::Random(3, 2);
  const Matrix traces = Matrix::Random(3, 2);
  // a law with one stiffness commutes with every orthogonal transform
  const auto force = [&](const Laws& laws) {
    return LocalStage(laws, 2).fields(1, data, traces).force;
  };
  EXPECT_LT((force(plain.with_columns("joint1", {group})) - force(plain)).norm(), 1e-14);
  // with two of them it does not
  group.parameters.emplace_back("normal",
                                interface::ParameterField((Matrix(1, 2) << 1.0, 5.0).finished()));
  const Laws random = plain.with_columns("joint1", {group});
  EXPECT_GT((force(random) - force(plain)).norm(), 1e-2);
  // the same matrix, given for every point
  EXPECT_EQ(plain.structure().interface(1).geometry.points, 1);
}

TEST(LocalStage, TransformsInSmallBlocksAreThoseOfTheWholeMatrix) {
  // 24 modes coupled in pairs, each in two time steps
  constexpr Index modes = 24;
  const Laws plain = chain::Scene{}.build().with_steps(2);
  Matrix turn = Matrix::Zero(modes, modes);
  for (Index k = 0; k < modes; k += 2) {
    const double angle = 0.1 * static_cast<double>(k + 1);
    turn.block<2, 2>(k, k) << std::cos(angle), std::sin(angle), -std::sin(angle), std::cos(angle);
  }
  const interface::ParameterField stiffness(
      Matrix(Vector::LinSpaced(2 * modes, 1.0, 5.0).transpose()));
  const Matrix data = Matrix::Random(3, 2 * modes);
  const Matrix traces = Matrix::Random(3, 2 * modes);
  const auto force = [&](const Matrix& forward, const Matrix& backward) {
    const LawColumns group{0, 1, {{forward, backward, {}, {}, {}}}, {{"normal", stiffness}}};
    const Laws laws = plain.with_columns("joint1", {group});
    const bool sparse = laws.of(1).groups->front().sparse_forward.size() > 0;
    EXPECT_EQ(sparse, forward(0, modes - 1) == 0.0);
    return LocalStage(laws, 2 * modes).fields(1, data, traces).force;
  };
  // numbers that are as good as zero, but not zero, are stored
  const Matrix whole = turn.array() + 1e-200;
  const Matrix expected = force(whole, whole.transpose());
  const double rounding = 1e-13 * expected.norm();
  EXPECT_LT((force(turn, turn.transpose()) - expected).norm(), rounding);
  EXPECT_LT((force(turn, {}) - expected).norm(), rounding);
  EXPECT_LT((force(whole, {}) - expected).norm(), rounding);
}

TEST(LocalStage, RefusesLawsThatDoNotFitItsColumns) {
  const Laws laws =
      chain::Scene{}.build().with_parameters({{"joint1", "normal", Matrix::Ones(1, 4)}});
  EXPECT_NO_THROW(LocalStage(laws, 4));
  EXPECT_THROW(LocalStage(laws, 3), InputError);
}

TEST(ResolveSamples, TakesParametersInPlaceOfThoseOfTheLaws) {
  const Laws laws = chain::Scene{}.build();
  const Matrix jump = (Matrix(1, 2) << 1.0, -2.0).finished();
  const double c = 2.0 / 1.3;
  const LocalFields fields =
      resolve_samples(laws, 1, jump, {{"normal", (Matrix(1, 2) << 1.0, 2.0).finished()}});
  EXPECT_NEAR(fields.force(0, 0), 1.0 / (1.0 + c), 1e-14);
  EXPECT_NEAR(fields.force(0, 1), -2.0 * 2.0 / (1.0 + 2.0 * c), 1e-14);
  EXPECT_THROW(static_cast<void>(resolve_samples(laws, 1, Matrix::Ones(2, 1), {})), InputError);
  EXPECT_THROW(static_cast<void>(resolve_samples(laws, 1, jump, {{"norml", Matrix::Ones(1, 1)}})),
               InputError);
  EXPECT_THROW(static_cast<void>(resolve_samples(laws, 1, jump, {{"normal", Matrix::Ones(1, 3)}})),
               InputError);
}

}  // namespace latin::substructure
