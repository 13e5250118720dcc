#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "chain.hpp"
#include "fixed_point.hpp"
#include "latin/common/error.hpp"
#include "substructure/body.hpp"

using fixed_point::random;
using latin::Index;
using latin::Matrix;
using latin::SparseRows;
using latin::Vector;
using latin::substructure::Body;

namespace {

/// A floating substructure with two sides of two rows each, its unknowns glued and shuffled by Z, offset,
/// two load patterns, and a spring to the ground.
struct Sample {
  Index n = 9;
  Index size = 8;
  SparseRows stiffness = chain::bar(9, 2.0);
  SparseRows z;
  Matrix load = random(9, 2, 1);
  Matrix offset = random(9, 2, 2);
  SparseRows left;
  SparseRows right;
  SparseRows ground = chain::at(4, 9);
  double kappa = 0.7;
  double jump = 0.4;
  Vector weights = (Vector(2) << 0.5, 1.5).finished();
  Vector direction = (Vector(2) << 2.0, 3.0).finished();

  Sample() {
    std::vector<Eigen::Triplet<double>> entries;
    for (int i = 0; i < 9; ++i) {
      entries.emplace_back(i, (i == 8 ? 5 : 7 - i), i == 8 ? 0.3 : 1.0);
    }
    z.resize(9, 8);
    z.setFromTriplets(entries.begin(), entries.end());
    const Matrix dense_left = random(2, 9, 3).leftCols(9).cwiseProduct(
        (Matrix(2, 9) << 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0).finished());
    left = dense_left.sparseView();
    right = Matrix(dense_left.rowwise().reverse()).sparseView();
  }

  [[nodiscard]] Body body(latin::substructure::OperatorKind kind,
                          latin::algebra::FactorBackend backend,
                          const Body* before = nullptr) const {
    const Matrix imposed = (Matrix(1, 2) << jump, 0.0).finished();  // of the first load pattern
    return {{"part",
             size,
             {{"part", latin::owning_view(stiffness), z, load, offset}},
             {{"ground", {0}, {ground}, Vector::Constant(1, kappa), imposed}}},
            {{0, left, weights, direction}, {0, right, weights, direction}},
            {kind, backend, 0.0},
            before};
  }
};

}  // namespace

class BodyOperators
    : public testing::TestWithParam<
          std::pair<latin::substructure::OperatorKind, latin::algebra::FactorBackend>> {};

TEST_P(BodyOperators, AgreeWithDenseAlgebra) {
  const Sample sample;
  const auto [kind, backend] = GetParam();
  if (backend == latin::algebra::FactorBackend::cholmod &&
      latin::algebra::available_backends().find("cholmod") == std::string::npos) {
    GTEST_SKIP() << "built without CHOLMOD";
  }
  const Body body = sample.body(kind, backend);
  ASSERT_EQ(body.rows(), 4);

  // the same, dense: unknowns q with u = Z q + u0 a
  Matrix trace(4, 9);
  trace << Matrix(sample.left), Matrix(sample.right);
  const Vector w = sample.weights.replicate(2, 1);
  const Vector k = sample.direction.replicate(2, 1);
  const Matrix z = sample.z;
  const Matrix ground = sample.ground;
  const Matrix full = Matrix(sample.stiffness) + sample.kappa * ground.transpose() * ground +
                      trace.transpose() * w.cwiseProduct(k).asDiagonal() * trace;
  Matrix force = sample.load;
  force.col(0) -=
      sample.kappa * sample.jump * ground.transpose();  // f = kappa (-w - jump) on the part
  const Matrix data = random(4, 3, 4);
  const Matrix amplitudes = random(2, 3, 5);
  const Matrix rhs =
      z.transpose() * (force * amplitudes + trace.transpose() * w.asDiagonal() * data -
                       full * sample.offset * amplitudes);
  const Matrix q = (z.transpose() * full * z).ldlt().solve(rhs);
  const Matrix u = z * q + sample.offset * amplitudes;

  const auto fields = body.displacements(data, amplitudes, body.response());
  ASSERT_EQ(fields.size(), 1U);
  EXPECT_LT((fields[0] - u).norm(), 1e-12 * u.norm());

  latin::substructure::BodyWork work;
  Matrix traces(4, 3);
  body.apply(data, traces, work);
  traces += body.response().traces * amplitudes;
  EXPECT_LT((traces - trace * u).norm(), 1e-12 * u.norm());

  const Matrix forces = data - k.asDiagonal() * traces;
  const Matrix elastic = Matrix(sample.stiffness) + sample.kappa * ground.transpose() * ground;
  const Vector energies = (u.transpose() * elastic * u).diagonal();
  EXPECT_LT(
      (body.energies(data, traces, forces, amplitudes, body.response(), work) - energies).norm(),
      1e-10 * energies.norm());

  // the operator without what is no unknown of a side: S = A_aa - A_ai A_ii^-1 A_ia = (the block of A^-1)^-1
  const SparseRows& own = body.active_traces();
  const Matrix schur = body.schur().selfadjointView<Eigen::Lower>();
  const Matrix operator_ = z.transpose() * full * z;
  const Matrix compliance = trace * z * operator_.ldlt().solve((trace * z).transpose());
  EXPECT_LT((Matrix(own) * schur.ldlt().solve(Matrix(own).transpose()) - compliance).norm(),
            1e-12 * compliance.norm());
}

TEST_P(BodyOperators, MeasureWhatRoundingLeavesOfAGluedBody) {
  const auto [kind, backend] = GetParam();
  if (backend == latin::algebra::FactorBackend::cholmod &&
      latin::algebra::available_backends().find("cholmod") == std::string::npos) {
    GTEST_SKIP() << "built without CHOLMOD";
  }
  if (backend == latin::algebra::FactorBackend::mumps) {
    GTEST_SKIP() << "does not say how much it leaves, and refuses a body whose stiff joint it "
                    "eliminates last";
  }
  // two bars, joined by a spring that is 1e10 times stiffer, and moved far
  const SparseRows bar = chain::bar(5, 2.0);
  const SparseRows joint = chain::at(4, 5);
  const SparseRows other = chain::at(0, 5);
  const auto of_bar = [](int first) {
    SparseRows z(5, 10);
    for (int i = 0; i < 5; ++i) {
      z.insert(i, first + i) = 1.0;
    }
    z.makeCompressed();
    return z;
  };
  const double stiff = 3e10;
  const Vector weight = Vector::Constant(1, 1.0);
  const Vector direction = Vector::Constant(1, 1e-3);
  const std::vector<latin::substructure::BodySide> sides{{0, chain::at(0, 5), weight, direction},
                                                         {1, chain::at(4, 5), weight, direction}};
  const Body body(
      {"bars",
       10,
       {{"one", latin::owning_view(bar), of_bar(0), random(5, 1, 1), Matrix()},
        {"two", latin::owning_view(bar), of_bar(5), random(5, 1, 2), Matrix()}},
       {{"joint", {0, 1}, {joint, other}, Vector::Constant(1, stiff), Matrix::Zero(1, 1)}}},
      sides, {kind, backend, 0.0});
  ASSERT_TRUE(body.measurable());
  const Matrix data = random(2, 1, 4);
  const Matrix amplitudes = Matrix::Ones(1, 1);

  using Longer = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  const auto longer = [](const Matrix& values) -> Longer { return values.cast<long double>(); };
  const Matrix z = (Matrix(10, 10) << Matrix(of_bar(0)), Matrix(of_bar(5))).finished();
  Longer full = Longer::Zero(10, 10);
  full.topLeftCorner(5, 5) = longer(Matrix(bar));
  full.bottomRightCorner(5, 5) = longer(Matrix(bar));
  Longer spring = Longer::Zero(1, 10);
  spring(0, 4) = -1.0L;
  spring(0, 5) = 1.0L;
  full += static_cast<long double>(stiff) * spring.transpose() * spring;
  full(0, 0) += static_cast<long double>(1e-3);
  full(9, 9) += static_cast<long double>(1e-3);
  Longer rhs(10, 1);
  rhs << longer(random(5, 1, 1)), longer(random(5, 1, 2));
  rhs(0, 0) += longer(data)(0, 0);
  rhs(9, 0) += longer(data)(1, 0);
  const Longer q = full.partialPivLu().solve(rhs);
  const Vector exact = (Longer(2, 1) << q(0, 0), q(9, 0)).finished().cast<double>();

  latin::substructure::BodyWork work;
  Matrix traces(2, 1);
  body.apply(data, traces, work);
  traces += body.response().traces * amplitudes;
  const Vector wrong = exact - traces.col(0);
  const Matrix defect = body.defect(data, amplitudes, body.response());
  const Matrix schur = body.schur().selfadjointView<Eigen::Lower>();
  const Vector found = Matrix(body.active_traces()) * schur.ldlt().solve(defect);
  // what is left is the rounding of the traces themselves, and of a first correction
  EXPECT_GT(wrong.norm(), 1e-10 * exact.norm());
  EXPECT_LT((found - wrong).norm(), 1e-2 * wrong.norm());
}

TEST(Body, KnowsWhatRoundingMayLeave) {
  if (latin::algebra::available_backends().find("cholmod") == std::string::npos) {
    GTEST_SKIP() << "built without CHOLMOD";
  }
  const auto rounding = [](double held) {
    const SparseRows ground = chain::at(0, 5);
    const Body body({"bar",
                     5,
                     {{"bar", chain::shared_bar(5), {}, chain::end_load(5, 1.0), {}}},
                     {{"ground", {0}, {ground}, Vector::Constant(1, held), Matrix::Zero(1, 1)}}},
                    {}, {});
    return body.rounding();
  };
  EXPECT_GT(rounding(1.0), 0.0);
  EXPECT_LT(rounding(1.0), 1e-13);
  // a spring of 1e-9 of the bar's stiffness alone holds it: as many digits are lost
  EXPECT_GT(rounding(1e-9), 1e-8);
  EXPECT_LT(rounding(1e-9), 1e-5);
}

INSTANTIATE_TEST_SUITE_P(Kinds, BodyOperators,
                         testing::Values(std::pair{latin::substructure::OperatorKind::condensed,
                                                   latin::algebra::FactorBackend::cholmod},
                                         std::pair{latin::substructure::OperatorKind::factored,
                                                   latin::algebra::FactorBackend::cholmod},
                                         std::pair{latin::substructure::OperatorKind::factored,
                                                   latin::algebra::FactorBackend::mumps}));

TEST(Body, CondensesOntoTheUnknownsOfItsSides) {
  const Sample sample;
  const Body body = sample.body(latin::substructure::OperatorKind::automatic,
                                latin::algebra::FactorBackend::automatic);
  EXPECT_EQ(body.active(), 4);
  EXPECT_EQ(body.size(), 8);
}

TEST(Body, AnswersTheSameOnceItMultipliesInsteadOfSolving) {
  // one row on three unknowns: the dense product is formed after a few columns
  const SparseRows mean = Matrix(Matrix::Constant(1, 3, 1.0 / 3.0)).sparseView();
  SparseRows trace(1, 9);
  for (int i = 0; i < 3; ++i) {
    trace.insert(0, i) = mean.coeff(0, i);
  }
  const auto stiffness = latin::owning_view(chain::bar(9, 2.0));
  const Body body({"bar", 9, {{"bar", stiffness, {}, Matrix::Zero(9, 0), {}}}, {}},
                  {{0, trace, Vector::Constant(1, 0.5), Vector::Constant(1, 2.0)}}, {});
  if (!body.condensed()) {
    GTEST_SKIP() << "the backend does not condense";
  }
  const Matrix data = random(1, 4, 7);
  latin::substructure::BodyWork work;
  Matrix first(1, 4);
  body.apply(data.leftCols(1), first.leftCols(1), work);
  EXPECT_NEAR(first(0, 0), data(0, 0) / 2.0, 1e-14);  // s = k w on a floating bar
  for (int i = 0; i < 20; ++i) {
    body.apply(data, first, work);
    EXPECT_LT((first - 0.5 * data).norm(), 1e-13 * data.norm());
  }
}

TEST(Body, AnswersTheSameOnceItMultipliesInsteadOfSolvingWithASparseFactor) {
  // three rows of sums over four nodes of a bar of twenty: a block of nine numbers fits where one of 144 does not
  SparseRows trace(3, 20);
  for (int i = 0; i < 12; ++i) {
    trace.insert(i / 4, i + i / 4) = 1.0 + 0.1 * i;
  }
  trace.makeCompressed();
  const Vector weights = (Vector(3) << 0.5, 1.5, 0.7).finished();
  const Vector direction = (Vector(3) << 2.0, 3.0, 0.4).finished();
  const SparseRows stiffness = chain::bar(20, 2.0);
  const auto with_limit = [&](double bytes) {
    return Body(
        {"bar", 20, {{"bar", latin::owning_view(stiffness), {}, Matrix::Zero(20, 0), {}}}, {}},
        {{0, trace, weights, direction}},
        {latin::substructure::OperatorKind::automatic, latin::algebra::FactorBackend::automatic,
         bytes});
  };
  const Matrix robin = weights.cwiseProduct(direction).asDiagonal();
  const Matrix dense = Matrix(stiffness) + Matrix(trace).transpose() * robin * Matrix(trace);
  const Matrix moved = Matrix(trace) * dense.ldlt().solve(Matrix(trace).transpose());
  for (const double bytes : {72.0, 71.0}) {  // with the block, and without
    const Body body = with_limit(bytes);
    ASSERT_FALSE(body.condensed());
    latin::substructure::BodyWork work;
    for (const Index columns : {1, 2, 12, 1}) {
      const Matrix data = random(3, columns, 7);
      const Matrix exact = moved * weights.asDiagonal() * data;
      Matrix found(3, columns);
      body.apply(data, found, work);
      EXPECT_LT((found - exact).norm(), 1e-13 * exact.norm());
      body.apply_single(data, found, work);
      EXPECT_LT((found - exact).norm(), 1e-13 * exact.norm());
    }
  }
}

TEST(Body, SaysWhichPartIsNotDefinite) {
  const Index n = 4;
  try {
    const Body body(
        {"loose", n, {{"loose", chain::shared_bar(n), {}, chain::end_load(n, 1.0), {}}}, {}}, {},
        {});
    FAIL() << "a floating bar was factorised";
  } catch (const latin::NumericalError& error) {
    EXPECT_NE(std::string(error.what()).find("loose"), std::string::npos);
  }
}

TEST(Body, RefusesShapesThatDisagree) {
  EXPECT_THROW(
      Body({"bad", 5, {{"bad", chain::shared_bar(4), {}, chain::end_load(4, 1.0), {}}}, {}}, {},
           {}),
      latin::InputError);
}

TEST(BodyWithOtherSides, KeepsItsSparseFactor) {
  using latin::algebra::FactorBackend;
  using latin::substructure::OperatorKind;
  if (latin::algebra::available_backends().find("cholmod") == std::string::npos) {
    GTEST_SKIP() << "built without CHOLMOD";
  }
  const Sample first;
  const Body before = first.body(OperatorKind::condensed, FactorBackend::cholmod);
  EXPECT_FALSE(before.kept());
  Sample other;
  other.direction = (Vector(2) << 0.04, 50.0).finished();
  other.weights = (Vector(2) << 0.7, 1.1).finished();
  other.left *= 1.7;  // other traces, on the same unknowns
  other.jump = 0.9;   // loads may differ
  const Body fresh = other.body(OperatorKind::condensed, FactorBackend::cholmod);
  const Body kept = other.body(OperatorKind::condensed, FactorBackend::cholmod, &before);
  const Body again = other.body(OperatorKind::condensed, FactorBackend::cholmod, &kept);
  EXPECT_TRUE(kept.kept());
  EXPECT_TRUE(again.kept());
  const Matrix data = random(4, 3, 7);
  const Matrix amplitudes = random(2, 3, 8);
  const auto factor_of = [](const Body& body) -> Matrix {
    return body.condensed_factor().triangularView<Eigen::Lower>();
  };
  for (const Body* body : {&kept, &again}) {
    EXPECT_LT((factor_of(*body) - factor_of(fresh)).norm(), 1e-13 * factor_of(fresh).norm());
    const Matrix one = fresh.displacements(data, amplitudes, fresh.response()).front();
    const Matrix two = body->displacements(data, amplitudes, body->response()).front();
    EXPECT_LT((one - two).norm(), 1e-12 * one.norm());
    EXPECT_LT((body->response().traces - fresh.response().traces).norm(),
              1e-12 * fresh.response().traces.norm());
  }
  // what changes inside is factorised anew
  Sample stiffer;
  stiffer.kappa = 0.8;
  EXPECT_FALSE(stiffer.body(OperatorKind::condensed, FactorBackend::cholmod, &before).kept());
  Sample finer;
  finer.stiffness.coeffs() *= 1.0 + 1e-15;
  EXPECT_FALSE(finer.body(OperatorKind::condensed, FactorBackend::cholmod, &before).kept());
  Sample moved;  // its side touches another unknown
  moved.left.coeffRef(0, 3) = 1.0;
  moved.left.makeCompressed();
  EXPECT_FALSE(moved.body(OperatorKind::condensed, FactorBackend::cholmod, &before).kept());
}
