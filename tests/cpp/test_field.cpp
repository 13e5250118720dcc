#include <gtest/gtest.h>

#include <cmath>
#include <unsupported/Eigen/KroneckerProduct>

#include "chain.hpp"
#include "latin/common/error.hpp"
#include "stochastic_sample.hpp"
#include "substructure/field.hpp"

namespace latin::substructure {
namespace {

constexpr Index nodes = 6;
constexpr Index cells = nodes - 1;

/// B of a bar, a row for each cell: B^T a B is its stiffness with the moduli a.
Matrix stretch_of_bar(double ea = 2.0) {
  Matrix stretch = Matrix::Zero(cells, nodes);
  for (Index cell = 0; cell < cells; ++cell) {
    const double root = std::sqrt(ea * static_cast<double>(cells));
    stretch(cell, cell) = -root;
    stretch(cell, cell + 1) = root;
  }
  return stretch;
}

const Vector initial = Vector::LinSpaced(cells, 0.2, -0.3);

/// A bar whose left end is prescribed, with the moduli of its cells, and two load patterns: forces inside, and an initial
/// strain with the displacement of the left end. Springs to the ground hold its last two nodes; a second bar may hang on
/// the first by a joint.
Laws build(const Vector& moduli, bool second = false) {
  const Matrix root = Matrix(moduli.cwiseSqrt().asDiagonal() * stretch_of_bar());
  const SparseRows matrix = Matrix(root.transpose() * root).sparseView();
  SparseRows prolongation(nodes, nodes - 1);
  for (Index node = 1; node < nodes; ++node) {
    prolongation.insert(node, node - 1) = 1.0;
  }
  prolongation.makeCompressed();
  Matrix load = Matrix::Zero(nodes, 2);
  Matrix offset = Matrix::Zero(nodes, 2);
  Matrix strained = Matrix::Zero(cells, 2);
  load.col(0) = Vector::LinSpaced(nodes, 1.0, 2.0);
  strained.col(1) = moduli.cwiseSqrt().cwiseProduct(initial);
  load += root.transpose() * strained;
  offset(0, 1) = 0.3;
  const auto side = [](const std::string& part, Index node, double direction) {
    return SideDescription{part, chain::at(node, nodes), Vector::Constant(1, direction), 1.0};
  };
  const Matrix one = Matrix::Ones(1, 1);
  const Vector area = Vector::Ones(1);
  std::vector<InterfaceDescription> interfaces;
  interfaces.push_back(
      {"in", "elastic", Vector::Constant(1, 2.0), one, {side("bar", nodes - 2, 0.4)}});
  interfaces.push_back({"end", "elastic", area, one, {side("bar", nodes - 1, 1.7)}});
  Member member{"bar", owning_view(matrix), prolongation, load, offset};
  member.stretch = root.sparseView();
  member.stretch_points = cells;
  member.initial_stretch = strained;
  std::vector<BodyDescription> bodies;
  bodies.push_back({"bar", nodes - 1, {member}, {}});
  if (second) {
    Matrix pull = Matrix::Zero(nodes, 2);
    pull(nodes - 1, 0) = 5.0;
    bodies.push_back({"rod", nodes, {{"rod", chain::shared_bar(nodes), {}, pull, {}}}, {}});
    interfaces.push_back(
        {"joint", "elastic", area, one, {side("bar", nodes - 1, 1.0), side("rod", 0, 2.0)}});
    interfaces.push_back(
        {"glue", "perfect", area, one, {side("rod", nodes - 1, 1.0), side("bar", 1, 2.0)}});
  }
  OperatorOptions options;
  options.kind = OperatorKind::condensed;
  std::vector<LawParameter> parameters{{"in", "normal", Matrix::Constant(1, 1, 3.0)},
                                       {"end", "normal", Matrix::Constant(1, 1, 5.0)}};
  if (second) {
    parameters.push_back({"joint", "normal", Matrix::Constant(1, 1, 4.0)});
  }
  return Laws(std::make_shared<const Structure>(std::move(bodies), std::move(interfaces), options))
      .with_parameters(parameters);
}

/// A modulus of two germs in the cells, with the mean 1.
struct Modulus {
  stochastic::ChaosBasis basis{
      {stochastic::Germ::family("hermite", {}), stochastic::Germ::family("legendre", {})},
      stochastic::MultiIndexSet(stochastic::total(2, 2))};
  std::shared_ptr<const stochastic::Coupling> change;

  Modulus() {
    const stochastic::MultiIndexSet property(stochastic::total(2, 1));
    Matrix coefficients = Matrix::Zero(cells, property.size());
    for (Index mode = 1; mode < property.size(); ++mode) {
      for (Index cell = 0; cell < cells; ++cell) {
        coefficients(cell, mode) = 0.1 * std::cos(static_cast<double>(mode * (cell + 1)));
      }
    }
    change = std::make_shared<const stochastic::Coupling>(basis, coefficients, property);
  }
  [[nodiscard]] Index modes() const { return basis.size(); }
  [[nodiscard]] std::map<std::string, StiffnessFactors> factors() const {
    StiffnessFactors own;
    own.coupling = change;
    return {{"bar", own}};
  }
  /// What a in all cells does to stretches (cells, modes).
  [[nodiscard]] Matrix times(const Matrix& stretches) const {
    Matrix stressed(stretches.rows(), stretches.cols());
    for (Index cell = 0; cell < cells; ++cell) {
      stressed.row(cell) = stretches.row(cell) + stretches.row(cell) * change->matrix(cell);
    }
    return stressed;
  }
};

std::map<std::string, StiffnessFactors> samples(const Matrix& fields) {
  StiffnessFactors own;
  own.field = fields;
  return {{"bar", own}};
}

}  // namespace

TEST(Field, ASampleIsABodyWithThatStiffness) {
  const Vector moduli = (Vector(cells) << 0.5, 1.0, 3.0, 0.7, 1.9).finished();
  const Laws laws = build(Vector::Ones(cells)).with_stiffness(samples(moduli));
  const Laws alone = build(moduli);
  const Matrix data = Matrix::Random(2, 3);
  const Matrix amplitudes = Matrix::Random(2, 3);
  const auto answer = [&](const Laws& of) {
    GlobalStage global(of);
    Matrix traces(2, 3);
    global.apply(data, amplitudes, traces);
    const Sizes sizes = global.sizes(data, traces, amplitudes);
    return std::tuple(traces, Matrix(sizes.strain), displacements(of, data, amplitudes)[0].second);
  };
  const auto [traces, strain, moved] = answer(laws);
  const auto [expected, of_alone, moved_alone] = answer(alone);
  EXPECT_LT((traces - expected).norm(), 1e-13 * expected.norm());
  EXPECT_LT((strain - of_alone).norm(), 1e-12 * of_alone.norm());
  EXPECT_LT((moved - moved_alone).norm(), 1e-13 * moved_alone.norm());
}

TEST(Field, SeveralSamplesAreOnlyReadAtOnce) {
  Matrix fields = Matrix::Ones(cells, 2);
  fields.col(1).setLinSpaced(cells, 0.5, 2.0);
  const Laws laws = build(Vector::Ones(cells)).with_stiffness(samples(fields));
  const Matrix data = Matrix::Random(2, 2);
  const Matrix amplitudes = Matrix::Random(2, 2);
  const Matrix moved = displacements(laws, data, amplitudes)[0].second;
  for (Index k = 0; k < 2; ++k) {
    const Laws alone = build(fields.col(k));
    const Matrix expected = displacements(alone, data.col(k), amplitudes.col(k))[0].second;
    EXPECT_LT((moved.col(k) - expected).norm(), 1e-13 * expected.norm());
  }
  stochastic::expect_mentions([&] { laws.check_columns(2); },
                              {"bar", "2 samples", "one after the other"});
}

/// B^T a (B u - g) = F + T^T W (s - k w), projected on the modes, step by step.
TEST(Field, ModesAreTheGalerkinSolution) {
  const Modulus modulus;
  const Index c = modulus.modes();
  const Laws laws =
      build(Vector::Ones(cells)).with_steps(2).with_modes(c).with_stiffness(modulus.factors());
  const Matrix data = Matrix::Random(2, 2 * c);
  const Matrix amplitudes = Matrix::Random(2, 2 * c);
  GlobalStage global(laws);
  Matrix traces(2, 2 * c);
  global.apply(data, amplitudes, traces);
  const Vector energies = global.sizes(data, traces, amplitudes).strain.col(0);
  const Matrix moved = displacements(laws, data, amplitudes)[0].second;
  EXPECT_LT((moved.bottomRows(2) - traces).norm(), 1e-13);
  const Matrix b = stretch_of_bar();
  for (Index step = 0; step < 2; ++step) {
    const auto own = Eigen::seqN(step, c, 2);
    const Matrix u = moved(latin::every, own);
    EXPECT_LT((u.row(0) - 0.3 * amplitudes(1, own)).norm(), 1e-14);
    const Matrix inner = b.transpose() * modulus.times(b * u - initial * amplitudes(1, own));
    Matrix outer = Vector::LinSpaced(nodes, 1.0, 2.0) * amplitudes(0, own);
    outer.row(nodes - 2) += 2.0 * (data(0, own) - 0.4 * traces(0, own));
    outer.row(nodes - 1) += data(1, own) - 1.7 * traces(1, own);
    EXPECT_LT((inner - outer).bottomRows(nodes - 1).norm(), 1e-10);
    const Matrix stretched = b * u;
    const double energy = stretched.cwiseProduct(modulus.times(stretched)).sum();
    EXPECT_NEAR(energies(2 * step) + energies(2 * step + 1), energy, 1e-10 * energy);
  }
}

TEST(Field, WhatWasSolvedIsKeptAndOtherDataAreNot) {
  const Modulus modulus;
  const Index c = modulus.modes();
  const Laws laws = build(Vector::Ones(cells)).with_modes(c).with_stiffness(modulus.factors());
  const FieldBody& field = *laws.field(0)->chaos;
  const Matrix data = Matrix::Random(2, c);
  const Matrix amplitudes = Matrix::Random(2, c);
  Matrix rough(2, c);
  Matrix exact(2, c);
  field.apply(data, amplitudes, rough, std::numeric_limits<double>::infinity());
  EXPECT_GT(field.left().norm(), 1e-3);
  field.apply(data, amplitudes, exact);
  EXPECT_GT((exact - rough).norm(), 1e-3);
  EXPECT_LT(field.left().norm(), 1e-10);
  // the next one of an iteration starts from there, and leaves a share of what that lacked
  const Matrix change = Matrix::Random(2, c);
  Matrix next(2, c);
  field.apply(data + change, amplitudes, next);
  Matrix moved(2, c);
  field.change(change, moved);  // as exact as changes are
  EXPECT_LT((next - exact - moved).norm(), 1e-2 * moved.norm());
  // displacements are exact, whatever was solved before
  const Matrix found = field.displacements(data, amplitudes).front();
  const Laws alone = build(Vector::Ones(cells)).with_modes(c).with_stiffness(modulus.factors());
  const Matrix expected = displacements(alone, data, amplitudes).front().second;
  EXPECT_LT((found - expected).norm(), 1e-11 * expected.norm());
  const Matrix of_change = displacements(alone, data + change, amplitudes).front().second;
  EXPECT_LT((of_change - expected).bottomRows(2).norm(), 2.0 * moved.norm());
  EXPECT_LT(((of_change - expected).bottomRows(2) - moved).norm(), 1e-5 * moved.norm());
}

TEST(Field, WhatDoesNotFitIsRefused) {
  const Laws laws = build(Vector::Ones(cells));
  const auto refused = [&](const std::map<std::string, StiffnessFactors>& factors,
                           const std::vector<std::string>& words) {
    stochastic::expect_mentions([&] { static_cast<void>(laws.with_stiffness(factors)); }, words);
  };
  refused(samples(Matrix::Ones(cells + 1, 1)), {"bar", "6 factors", "5 points"});
  refused(samples(-Matrix::Ones(cells, 1)), {"bar", "-1", "positive"});
  const Modulus modulus;
  StiffnessFactors other;
  other.coupling = std::make_shared<const stochastic::Coupling>(
      modulus.basis, Matrix::Zero(cells + 2, 1),
      stochastic::MultiIndexSet(stochastic::total(2, 0)));
  refused({{"bar", other}}, {"bar", "7 points", "5 points"});
}

/// A field, a random factor, a random joint and a rigid one: solved at once, in fewer rounds than there may be, to the
/// dense Galerkin system.
TEST(Coupled, SolvesEverythingThatVariesAtOnce) {
  const Modulus modulus;
  const Index c = modulus.modes();
  const double cosine = std::cos(0.4);
  const double sine = std::sin(0.4);
  // of the rod and of the joint: rotations of the first two modes
  Matrix turned = Matrix::Identity(c, c);
  turned.topLeftCorner(2, 2) << cosine, sine, -sine, cosine;
  Vector values = Vector::Ones(c);
  values.head(2) << 0.6, 1.5;
  std::map<std::string, StiffnessFactors> factors = modulus.factors();
  factors["rod"] = {values, turned};
  LawColumns columns;
  columns.end = 1;
  columns.transforms.push_back({turned, {}, {}, {}, {}});
  columns.parameters.emplace_back("normal", Matrix(4.0 * values.transpose()));
  const Laws laws = build(Vector::Ones(cells), true)
                        .with_modes(c)
                        .with_columns("joint", {columns})
                        .with_stiffness(factors);
  Matrix amplitudes = Matrix::Zero(2, c);
  amplitudes(0, 0) = 1.0;
  amplitudes.row(1).setLinSpaced(0.5, -0.2);
  iteration::Options options = chain::options(10, 1e-8);
  iteration::State state;
  const iteration::Summary summary = iteration::solve(laws, options, amplitudes, state, {}, {});
  EXPECT_EQ(summary.status, iteration::Status::converged);
  EXPECT_LE(summary.iterations, 4);
  const auto moved = displacements(laws, state.data, amplitudes);

  // unknowns of the bar, then of the rod, each with all modes
  const Matrix coupling = turned * values.asDiagonal() * turned.transpose();
  const Index n = 2 * nodes;
  Matrix whole = Matrix::Zero(n * c, n * c);
  const Matrix unit = Matrix::Identity(c, c);
  const Matrix b = stretch_of_bar();
  Matrix load = Matrix::Zero(n, c);
  load.topRows(nodes) = Vector::LinSpaced(nodes, 1.0, 2.0) * amplitudes.row(0);
  load.row(n - 1) += 5.0 * amplitudes.row(0);
  for (Index cell = 0; cell < cells; ++cell) {
    Vector row = Vector::Zero(n);
    row.head(nodes) = b.row(cell).transpose();
    const Matrix a = unit + modulus.change->matrix(cell);
    whole += Matrix(Eigen::kroneckerProduct(Matrix(row * row.transpose()), a));
    load += row * initial(cell) * amplitudes.row(1) * a;
  }
  const auto add = [&](const Vector& jump, const Matrix& stiffness) {
    whole += Matrix(Eigen::kroneckerProduct(Matrix(jump * jump.transpose()), stiffness));
  };
  const auto at = [n](Index node) { return Vector(Vector::Unit(n, node)); };
  Matrix rod = Matrix::Zero(n, n);
  rod.bottomRightCorner(nodes, nodes) = Matrix(chain::bar(nodes));
  whole += Matrix(Eigen::kroneckerProduct(rod, coupling));
  add(at(nodes - 2), 2.0 * 3.0 * unit);
  add(at(nodes - 1), 5.0 * unit);
  add(at(nodes) - at(nodes - 1), 4.0 * coupling);
  // the rigid one by elimination, and the prescribed end
  Matrix reduce = Matrix::Zero(n, n - 2);
  for (Index node = 1; node + 1 < n; ++node) {
    reduce(node, node - 1) = 1.0;
  }
  reduce(n - 1, 0) = 1.0;
  const Matrix all = Eigen::kroneckerProduct(reduce, unit);
  Matrix given = Matrix::Zero(n, c);
  given.row(0) = 0.3 * amplitudes.row(1);
  const auto stacked = [](const Matrix& block) {
    return Vector(Matrix(block.transpose()).reshaped());
  };
  const Vector right = all.transpose() * (stacked(load) - whole * stacked(given));
  const Vector found =
      all * Matrix(all.transpose() * whole * all).ldlt().solve(right) + stacked(given);
  const Matrix expected = found.reshaped(c, n).transpose();
  EXPECT_LT((moved[0].second - expected.topRows(nodes)).norm(), 1e-8 * expected.norm());
  EXPECT_LT((moved[1].second - expected.bottomRows(nodes)).norm(), 1e-8 * expected.norm());
}

}  // namespace latin::substructure
