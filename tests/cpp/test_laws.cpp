#include <gtest/gtest.h>

#include <functional>

#include "bars.hpp"
#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

Matrix number(double value) { return Matrix::Constant(1, 1, value); }

LawColumns identity(Index columns) {
  const Matrix one = Matrix::Identity(columns, columns);
  return {0, 1, {{one, one, {}, {}, {}}}, {}};
}

void expect_refused(const std::function<Laws()>& make, const std::string& words) {
  try {
    static_cast<void>(make());
    ADD_FAILURE() << "not refused: " << words;
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find(words), std::string::npos)
        << error.what() << "\n lacks: " << words;
  }
}

double end_of(const Laws& laws) {
  iteration::State state;
  const auto options = chain::options();
  iteration::solve(laws, options, Matrix::Ones(1, 1), state, {}, {});
  return chain::end_displacement(laws, state);
}

}  // namespace

TEST(Laws, AreValues) {
  const chain::Scene scene;
  const Laws laws = scene.build();
  const Laws soft = laws.with_parameters({{"joint1", "normal", number(1.0)}});
  EXPECT_EQ(laws.parameter("joint1", "normal")(0, 0), 3.0);
  EXPECT_EQ(soft.parameter("joint1", "normal")(0, 0), 1.0);
  EXPECT_NEAR(end_of(laws), scene.exact(), 1e-8);
  EXPECT_NEAR(end_of(soft), (chain::Scene{.stiffness = 1.0}).exact(), 1e-8);
  EXPECT_NEAR(end_of(laws), scene.exact(), 1e-8);
  // what was left as it was is shared
  EXPECT_EQ(soft.of(0).law, laws.of(0).law);
  EXPECT_EQ(laws.with_steps(1).of(1).law, laws.of(1).law);
}

TEST(Laws, NameWhatDoesNotFit) {
  const Laws laws = chain::Scene{}.build();
  expect_refused([&] { return laws.with_parameters({{"joint1", "norml", number(1.0)}}); },
                 "interface 'joint1': law 'elastic' has no parameter 'norml'");
  expect_refused([&] { return laws.with_parameters({{"joint1", "normal", number(-1.0)}}); },
                 "interface 'joint1': parameter 'normal'");
  expect_refused([&] { return laws.with_parameters({{"joint1", "normal", Matrix::Ones(2, 1)}}); },
                 "interface 'joint1': parameter 'normal' has 2 rows");
  expect_refused([&] { return laws.with_parameters({{"roof", "normal", number(1.0)}}); },
                 "no active interface 'roof'");
  expect_refused([&] { return laws.with_steps(0); }, "0 time steps");
  expect_refused([&] { return laws.with_columns("joint1", {{0, 2, {}, {}}}); },
                 "interface 'joint1': column transforms");
  expect_refused([&] { return laws.with_extra_loads({{"rod", Matrix::Ones(5, 1)}}); }, "'rod'");
  expect_refused([&] { return laws.with_extra_loads({{"bar0", Matrix::Ones(4, 1)}}); },
                 "extra load 4 x 1, expected 5 x 1");
  EXPECT_THROW(static_cast<void>(laws.parameter("joint1", "norml")), InputError);
  EXPECT_THROW(laws.with_parameters({{"joint1", "normal", Matrix::Ones(1, 3)}}).check_columns(2),
               InputError);
  EXPECT_THROW(laws.with_steps(2).check_columns(3), InputError);
}

TEST(Laws, ParametersReachTransformedColumns) {
  const chain::Scene scene;
  const Laws transformed = scene.build().with_columns("joint1", {identity(1)});
  EXPECT_TRUE(transformed.transformed());
  EXPECT_NEAR(end_of(transformed), scene.exact(), 1e-8);
  const Laws soft = transformed.with_parameters({{"joint1", "normal", number(1.0)}});
  EXPECT_NEAR(end_of(soft), (chain::Scene{.stiffness = 1.0}).exact(), 1e-8);
}

TEST(Laws, AParameterThatATransformGivesIsRefused) {
  LawColumns given = identity(1);
  given.parameters.emplace_back("normal", interface::ParameterField(2.0));
  const Laws laws = chain::Scene{}.build().with_columns("joint1", {given});
  EXPECT_NEAR(end_of(laws), (chain::Scene{.stiffness = 2.0}).exact(), 1e-8);
  expect_refused([&] { return laws.with_parameters({{"joint1", "normal", number(1.0)}}); },
                 "interface 'joint1': parameter 'normal' is given by the transforms");
  const Laws without = laws.with_columns("joint1", {});
  EXPECT_FALSE(without.transformed());
  EXPECT_NEAR(end_of(without), (chain::Scene{}).exact(), 1e-8);
}

TEST(Laws, ExtraLoadsAreAddedAndTakenAway) {
  const chain::Scene scene;
  const Laws laws = scene.build();
  const Laws pulled = laws.with_extra_loads({{"bar1", chain::end_load(scene.nodes, 1.0)}});
  EXPECT_NEAR(end_of(pulled), 1.5 * scene.exact(), 1e-8);  // 3 instead of 2
  EXPECT_NEAR(end_of(laws), scene.exact(), 1e-8);
  EXPECT_NEAR(end_of(pulled.with_extra_loads({})), scene.exact(), 1e-8);
}

TEST(Laws, AreRepeatedForSetsSideBySide) {
  const Laws laws = chain::Scene{}.build().with_parameters(
      {{"joint1", "normal", (Matrix(1, 2) << 1.0, 2.0).finished()}});
  const Laws twice = laws.repeated(2);
  EXPECT_EQ(twice.parameter("joint1", "normal"), (Matrix(1, 4) << 1.0, 2.0, 1.0, 2.0).finished());
  EXPECT_EQ(twice.parameter("joint1", "jump").cols(), 1);
  expect_refused([&] { return laws.with_columns("joint1", {identity(2)}).repeated(2); },
                 "interface 'joint1': parameter sets are not solved side by side");
}

TEST(Laws, KeepTheirPairsWhereTheStiffnessStays) {
  const Laws laws = chain::Bars{.parts = 2}.build();
  ASSERT_TRUE(laws.preconditions());
  Matrix residual = Matrix::Ones(laws.structure().rows(), 1);
  laws.precondition(residual);
  const Laws shifted = laws.with_parameters({{"joint1", "jump", number(0.1)}});
  EXPECT_EQ(shifted.of(0).pair->made(), laws.of(0).pair->made());
  EXPECT_NE(laws.of(0).pair->made(), nullptr);
  const Laws stiffer = laws.with_parameters({{"joint1", "normal", number(30.0)}});
  EXPECT_EQ(stiffer.of(0).pair->made(), nullptr);
}

}  // namespace latin::substructure
