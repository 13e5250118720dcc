#include <gtest/gtest.h>

#include <cmath>

#include "chain.hpp"
#include "iteration/sweep.hpp"
#include "latin/common/error.hpp"
#include "substructure/scaled.hpp"

namespace latin::substructure {
namespace {

constexpr Index nodes = 6;

/// A bar whose left end is prescribed, with two load patterns: forces inside, and loads that come from its stiffness,
/// with the displacement of the left end. Its active interfaces are on the last two nodes.
Laws build(double factor, OperatorKind kind = OperatorKind::condensed) {
  const SparseRows matrix = factor * chain::bar(nodes, 2.0);
  SparseRows prolongation(nodes, nodes - 1);
  for (Index node = 1; node < nodes; ++node) {
    prolongation.insert(node, node - 1) = 1.0;
  }
  prolongation.makeCompressed();
  Matrix load = Matrix::Zero(nodes, 2);
  Matrix of_stiffness = Matrix::Zero(nodes, 2);
  Matrix offset = Matrix::Zero(nodes, 2);
  load.col(0) = Vector::LinSpaced(nodes, 1.0, 2.0);
  of_stiffness(1, 1) = -0.7;
  of_stiffness(nodes - 1, 1) = 0.7;
  offset(0, 1) = 0.3;
  load += factor * of_stiffness;
  const auto side = [](Index node, double direction) {
    return SideDescription{"bar", chain::at(node, nodes), Vector::Constant(1, direction), 1.0};
  };
  std::vector<InterfaceDescription> interfaces;
  const Matrix one = Matrix::Ones(1, 1);
  interfaces.push_back({"in", "elastic", Vector::Constant(1, 2.0), one, {side(nodes - 2, 0.4)}});
  interfaces.push_back({"end", "elastic", Vector::Ones(1), one, {side(nodes - 1, 1.7)}});
  std::vector<BodyDescription> bodies;
  bodies.push_back(
      {"bar",
       nodes - 1,
       {{"bar", owning_view(matrix), prolongation, load, offset, factor * of_stiffness}},
       {}});
  OperatorOptions options;
  options.kind = kind;
  return Laws(std::make_shared<const Structure>(std::move(bodies), std::move(interfaces), options));
}

/// Every second column.
Matrix of_step(const Matrix& block, Index step) {
  Matrix columns(block.rows(), 2);
  columns << block.col(step), block.col(step + 2);
  return columns;
}

const Vector factors = (Vector(3) << 0.2, 1.0, 5.0).finished();

}  // namespace

TEST(Scaled, AnswersAreThoseOfABodyWithThatStiffness) {
  const Laws laws = build(1.0).with_stiffness({{"bar", {factors, {}}}});
  const Matrix data = Matrix::Random(2, 6);
  const Matrix amplitudes = Matrix::Random(2, 6);
  Matrix traces(2, 6);
  GlobalStage global(laws);
  global.apply(data, amplitudes, traces);
  const Sizes sizes = global.sizes(data, traces, amplitudes);
  const Matrix moved = displacements(laws, data, amplitudes).front().second;
  for (Index k = 0; k < 3; ++k) {
    const Laws alone = build(factors(k));
    GlobalStage one(alone);
    Matrix expected(2, 2);
    one.apply(data.middleCols(2 * k, 2), amplitudes.middleCols(2 * k, 2), expected);
    EXPECT_LT((traces.middleCols(2 * k, 2) - expected).norm(), 1e-13 * expected.norm());
    const Matrix fields =
        displacements(alone, data.middleCols(2 * k, 2), amplitudes.middleCols(2 * k, 2))
            .front()
            .second;
    EXPECT_LT((moved.middleCols(2 * k, 2) - fields).norm(), 1e-12 * fields.norm());
    const Sizes of_one =
        one.sizes(data.middleCols(2 * k, 2), expected, amplitudes.middleCols(2 * k, 2));
    EXPECT_LT((sizes.strain.middleRows(2 * k, 2) - of_one.strain).norm(),
              1e-12 * of_one.strain.norm());
  }
}

TEST(Scaled, AChangeIsThatOfTheData) {
  const Laws laws = build(1.0).with_stiffness({{"bar", {factors, {}}}});
  GlobalStage global(laws);
  const Matrix data = Matrix::Random(2, 3);
  const Matrix change = Matrix::Random(2, 3);
  const Matrix amplitudes = Matrix::Ones(2, 3);
  Matrix traces(2, 3);
  Matrix exact(2, 3);
  global.apply(data, amplitudes, traces);
  global.change(change, traces);
  global.apply(data + change, amplitudes, exact);
  EXPECT_LT((traces - exact).norm(), 1e-13);
}

/// The factor is a matrix A = V diag(a) V^T that couples the columns: sum_k A_jk K u_k = ...
TEST(Scaled, TransformedColumnsAreCoupled) {
  const double c = std::cos(0.3);
  const double s = std::sin(0.3);
  const Matrix forward = (Matrix(2, 2) << c, s, -s, c).finished();
  const Vector values = (Vector(2) << 0.5, 3.0).finished();
  const Laws laws = build(1.0).with_steps(2).with_stiffness({{"bar", {values, forward}}});
  const Matrix data = Matrix::Random(2, 4);
  const Matrix amplitudes = Matrix::Random(2, 4);
  const Matrix moved = displacements(laws, data, amplitudes).front().second;
  Matrix traces(2, 4);
  GlobalStage(laws).apply(data, amplitudes, traces);
  EXPECT_LT((moved.bottomRows(2) - traces).norm(), 1e-13);
  // equilibrium at the free nodes, step by step
  const Matrix coupling = forward * values.asDiagonal() * forward.transpose();
  const Matrix k = Matrix(chain::bar(nodes, 2.0));
  Matrix of_stiffness = Matrix::Zero(nodes, 2);
  of_stiffness(1, 1) = -0.7;
  of_stiffness(nodes - 1, 1) = 0.7;
  Matrix load = Matrix::Zero(nodes, 2);
  load.col(0) = Vector::LinSpaced(nodes, 1.0, 2.0);
  for (Index step = 0; step < 2; ++step) {
    const Matrix u = of_step(moved, step);
    const Matrix amplitude = of_step(amplitudes, step);
    const Matrix forces = of_step(data, step);
    const Matrix faces = of_step(traces, step);
    const Matrix inner = (k * u - of_stiffness * amplitude) * coupling;
    Matrix outer = load * amplitude;
    outer.row(nodes - 2) += 2.0 * (forces.row(0) - 0.4 * faces.row(0));
    outer.row(nodes - 1) += forces.row(1) - 1.7 * faces.row(1);
    EXPECT_LT((inner - outer).bottomRows(nodes - 1).norm(), 1e-12);
  }
}

TEST(Scaled, ASweepIsThatOfItsPoints) {
  const chain::Scene scene{.parts = 3};
  const Laws laws = scene.build();
  const Matrix values = (Matrix(1, 5) << 0.3, 0.7, 1.0, 2.0, 6.0).finished();
  std::vector<iteration::SweptParameter> swept(1);
  swept[0] = {"bar1", iteration::stiffness_parameter, Matrix::Ones(1, 1), values};
  std::vector<double> ends(5);
  iteration::sweep(laws, chain::options(), Matrix::Ones(1, 1), swept, {0, 1, 2, 3, 4}, {}, {}, {},
                   [&](Index point, const Laws& own, const iteration::Summary& summary,
                       const iteration::State& state) {
                     EXPECT_EQ(summary.status, iteration::Status::converged);
                     ends[static_cast<std::size_t>(point)] =
                         displacements(own, state.data, Matrix::Ones(1, 1)).back().second(4, 0);
                   });
  for (std::size_t k = 0; k < 5; ++k) {
    // bars and springs in series
    const double exact = 2.0 * (2.0 + 1.0 / values(0, static_cast<Index>(k)) + 2.0 / 3.0);
    EXPECT_NEAR(ends[k], exact, 1e-5 * exact);
  }
}

TEST(Scaled, WhatHasNoFactorIsRefused) {
  const Laws laws = build(1.0);
  EXPECT_THROW(static_cast<void>(laws.with_stiffness({{"rod", {factors, {}}}})), InputError);
  EXPECT_THROW(static_cast<void>(laws.with_stiffness({{"bar", {-factors, {}}}})), InputError);
  EXPECT_THROW(static_cast<void>(laws.with_stiffness({{"bar", {factors, Matrix::Ones(2, 2)}}})),
               InputError);
  EXPECT_THROW(static_cast<void>(
                   build(1.0, OperatorKind::factored).with_stiffness({{"bar", {factors, {}}}})),
               InputError);
  EXPECT_THROW(laws.with_stiffness({{"bar", {factors, {}}}}).check_columns(4), InputError);
}

}  // namespace latin::substructure
