#include <gtest/gtest.h>

#include "latin/common/error.hpp"
#include "stochastic/coupling.hpp"
#include "stochastic/galerkin.hpp"
#include "stochastic/galerkin_operator.hpp"
#include "stochastic_sample.hpp"

namespace latin::stochastic {
namespace {

/// A field on three points in the germs of the sample, and the couplings that belong to it.
struct Field {
  ChaosBasis basis{mixed_germs(), mixed_set()};
  MultiIndexSet property{total(3, 2)};
  Matrix coefficients = Matrix::Random(3, property.size());
  std::shared_ptr<const Coupling> coupling =
      std::make_shared<const Coupling>(basis, coefficients, property);
};

/// A spring chain of n unknowns.
SparseRows chain(Index n) {
  SparseRows matrix(n, n);
  for (Index i = 0; i < n; ++i) {
    matrix.coeffRef(i, i) = 2.5;
    if (i > 0) {
      matrix.coeffRef(i, i - 1) = matrix.coeffRef(i - 1, i) = -1.0;
    }
  }
  matrix.makeCompressed();
  return matrix;
}

}  // namespace

TEST(Coupling, HoldsTheGalerkinMatrixOfEveryPoint) {
  const Field field;
  for (Index point = 0; point < 3; ++point) {
    const Matrix expected =
        galerkin_matrix(field.basis, field.coefficients.row(point).transpose(), field.property);
    EXPECT_LT((field.coupling->matrix(point) - expected).cwiseAbs().maxCoeff(),
              1e-14 * expected.cwiseAbs().maxCoeff());
  }
  EXPECT_THROW(static_cast<void>(field.coupling->matrix(3)), InputError);
  EXPECT_EQ(field.coupling->second().size(), field.coupling->first().size());
}

TEST(Coupling, ProductIsThatOfTheMatrices) {
  const Field field;
  const Index c = field.basis.size();
  const ModeRows u = ModeRows::Random(6, c);  // two components a point
  ModeRows v(6, c);
  field.coupling->apply(u, 2, v);
  for (Index row = 0; row < 6; ++row) {
    const Vector expected = field.coupling->matrix(row / 2) * u.row(row).transpose();
    EXPECT_LT((v.row(row).transpose() - expected).norm(), 1e-14 * expected.norm() * c);
  }
  EXPECT_THROW(field.coupling->apply(u, 3, v), InputError);
}

TEST(Coupling, SmallestEigenvalueAndItsBound) {
  const Field field;
  double smallest = std::numeric_limits<double>::infinity();
  for (Index point = 0; point < 3; ++point) {
    const double own =
        Eigen::SelfAdjointEigenSolver<Matrix>(field.coupling->matrix(point)).eigenvalues()(0);
    EXPECT_LE(field.coupling->bounds()(point), own + 1e-12);
    smallest = std::min(smallest, own);
  }
  EXPECT_NEAR(field.coupling->smallest(), smallest, 1e-12 * std::abs(smallest));
}

TEST(GalerkinOperator, EqualsTheFormedMatrixAsBlockAndAsShell) {
  const Field field;
  const Index c = field.basis.size();
  const Index n = 4;
  // jumps of two components at three points
  Matrix jump = Matrix::Random(6, n);
  jump(1, 2) = 0.0;
  const Vector weights = Vector::LinSpaced(3, 0.5, 2.0);
  Matrix expected = Matrix::Zero(n * c, n * c);
  const Matrix fixed = chain(n);
  for (Index a = 0; a < n; ++a) {
    for (Index b = 0; b < n; ++b) {
      auto block = expected.block(a * c, b * c, c, c);
      block += fixed(a, b) * Matrix::Identity(c, c);
      for (Index row = 0; row < 6; ++row) {
        block += jump(row, a) * weights(row / 2) * jump(row, b) * field.coupling->matrix(row / 2);
      }
    }
  }
  const auto applied = std::make_shared<const GalerkinOperator>(
      chain(n),
      std::vector<GalerkinOperator::Term>{{SparseRows(jump.sparseView()), weights, field.coupling}},
      c);
  const ModeRows u = ModeRows::Random(n, c);
  ModeRows v(n, c);
  applied->apply(u, v);
  const Vector wanted = expected * Eigen::Map<const Vector>(u.data(), n * c);
  const double rounding = 1e-13 * wanted.norm();
  EXPECT_LT((Eigen::Map<const Vector>(v.data(), n * c) - wanted).norm(), rounding);

  const algebra::MatHandle shell = shell_matrix(applied);
  algebra::VecHandle x;
  algebra::VecHandle y;
  algebra::check(MatCreateVecs(shell.get(), x.out(), y.out()), "create vectors");
  for (PetscInt i = 0; i < static_cast<PetscInt>(n * c); ++i) {
    algebra::check(VecSetValue(x.get(), i, u.data()[i], INSERT_VALUES), "set");
  }
  algebra::check(MatMult(shell.get(), x.get(), y.get()), "multiply");
  const PetscScalar* values = nullptr;
  algebra::check(VecGetArrayRead(y.get(), &values), "read");
  EXPECT_LT((Eigen::Map<const Vector>(values, n * c) - wanted).norm(), rounding);
  algebra::check(VecRestoreArrayRead(y.get(), &values), "restore");
  EXPECT_THROW(GalerkinOperator(chain(n), {}, 0), InputError);
  EXPECT_THROW(
      GalerkinOperator(chain(n + 1), {{SparseRows(jump.sparseView()), weights, field.coupling}}, c),
      InputError);
}

}  // namespace latin::stochastic
