#include <gtest/gtest.h>

#include <functional>
#include <thread>

#include "bars.hpp"
#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

/// One bar of four nodes that a wall holds.
struct Held {
  std::vector<BodyDescription> bodies{
      {"bar", 4, {{"bar", chain::shared_bar(4), {}, chain::end_load(4, 1.0), {}}}, {}}};
  std::vector<InterfaceDescription> interfaces{{"wall",
                                                "perfect",
                                                Vector::Ones(1),
                                                Matrix::Ones(1, 1),
                                                {{"bar", chain::at(0, 4), Vector::Ones(1), 1.0}}}};
};

std::string refusal(const std::function<void(Held&)>& change) {
  Held held;
  change(held);
  try {
    const Structure structure(std::move(held.bodies), std::move(held.interfaces), {});
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST(Structure, StacksTheSidesOfItsBodies) {
  const Laws laws = chain::Scene{.parts = 3}.build();
  const Structure& structure = laws.structure();
  EXPECT_EQ(structure.rows(), 5);  // wall, and two sides of two joints
  EXPECT_EQ(structure.total_rows(), 5);
  EXPECT_EQ(structure.unknowns(), 15);
  EXPECT_EQ(structure.active_unknowns(), 5);
  EXPECT_EQ(structure.interface_unknowns(), 3);
  EXPECT_EQ(structure.loads(), 1);
  const ActiveInterface& joint = structure.interface(structure.find_interface("joint2"));
  EXPECT_EQ(joint.rows, (std::vector<Index>{3, 4}));
  EXPECT_DOUBLE_EQ(joint.flexibility(0), 2.0 / 1.3);
  EXPECT_EQ(structure.directions(), Vector::Constant(5, 1.3));
  EXPECT_TRUE(structure.has_interface("wall"));
  EXPECT_FALSE(structure.has_interface("roof"));
  EXPECT_THROW(static_cast<void>(structure.find_interface("roof")), InputError);
}

TEST(Structure, NamesWhatDoesNotFit) {
  const auto expect = [](const std::function<void(Held&)>& change, const std::string& words) {
    const std::string text = refusal(change);
    EXPECT_NE(text.find(words), std::string::npos) << text << "\n lacks: " << words;
  };
  expect([](Held& h) { h.interfaces[0].sides.clear(); }, "'wall': 0 sides");
  expect([](Held& h) { h.interfaces[0].weights(0) = -1.0; }, "weights must be positive");
  expect([](Held& h) { h.interfaces[0].frames.resize(1, 0); }, "frame rows for 1 points");
  expect([](Held& h) { h.interfaces[0].sides[0].direction(0) = 0.0; }, "positive and finite");
  expect([](Held& h) { h.interfaces[0].sides[0].scale = 0.0; }, "scale is 0");
  expect([](Held& h) { h.interfaces[0].sides[0].member = "rod"; }, "unknown substructure 'rod'");
  expect([](Held& h) { h.interfaces[0].sides[0].trace = chain::at(0, 5); }, "a trace 1 x 5");
  expect([](Held& h) { h.interfaces[0].basis = Matrix::Ones(2, 1); }, "a coarse basis of 2 rows");
  expect([](Held& h) { h.interfaces.push_back(h.interfaces[0]); }, "two of this name");
  expect([](Held& h) { h.bodies.push_back(h.bodies[0]); }, "'bar' is in two bodies");
  expect(
      [](Held& h) {
        h.interfaces[0].law = "contact";
        h.interfaces[0].paired = true;
      },
      "law 'contact' is nonlinear and cannot be paired");
}

TEST(Structure, MakesItsCoarseProblemAndItsFlexibilityOnceForAllThreads) {
  const Laws laws = chain::Bars{.parts = 6}.build();
  const Structure& structure = laws.structure();
  std::vector<const Macro*> macros(4);
  std::vector<const Flexibility*> flexibilities(4);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < 4; ++i) {
    threads.emplace_back([&, i] {
      macros[i] = &structure.macro();
      if (structure.has_flexibility()) {
        flexibilities[i] = &structure.flexibility();
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(std::ranges::count(macros, macros[0]), 4);
  EXPECT_EQ(std::ranges::count(flexibilities, flexibilities[0]), 4);
}

TEST(Structure, SeveralThreadsSolveOnOne) {
  const chain::Scene scene{.parts = 4};
  const Laws laws = scene.build();
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&laws, &scene, i] {
      for (int n = 0; n < 20; ++n) {
        chain::Scene own = scene;
        own.stiffness = 1.0 + 0.5 * i;
        std::vector<LawParameter> changes;
        for (int joint = 1; joint < 4; ++joint) {
          changes.push_back(
              {"joint" + std::to_string(joint), "normal", Matrix::Constant(1, 1, own.stiffness)});
        }
        const Laws changed = laws.with_parameters(changes);
        iteration::State state;
        const auto options = chain::options();
        const auto summary = iteration::solve(changed, options, Matrix::Ones(1, 1), state, {}, {});
        EXPECT_EQ(summary.status, iteration::Status::converged);
        EXPECT_NEAR(chain::end_displacement(changed, state), own.exact(), 1e-8);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

}  // namespace latin::substructure
