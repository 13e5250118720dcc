#include <gtest/gtest.h>

#include "stochastic/galerkin.hpp"
#include "stochastic/quadrature.hpp"
#include "stochastic/transform.hpp"
#include "stochastic_sample.hpp"

namespace latin::stochastic {

TEST(ColumnTransform, GalerkinDiagonalisesExactly) {
  const ChaosBasis basis(mixed_germs(), mixed_set());
  const SparseColumns a = matrix_of_germ(basis, 1);
  const ColumnTransform transform = galerkin_transform(a);
  const Matrix identity = Matrix::Identity(basis.size(), basis.size());
  EXPECT_LT((transform.forward * transform.backward - identity).cwiseAbs().maxCoeff(), 1e-13);
  const Matrix rebuilt = transform.forward * transform.values.asDiagonal() * transform.backward;
  EXPECT_LT((rebuilt - Matrix(a)).cwiseAbs().maxCoeff(), 1e-12);
  SparseColumns skew(2, 2);
  skew.insert(0, 1) = 1.0;
  EXPECT_THROW(static_cast<void>(galerkin_transform(skew)), InputError);
}

TEST(ColumnTransform, QuadratureIsTheIdentityOnModes) {
  const ChaosBasis basis(mixed_germs(), mixed_set());
  const ColumnTransform tensor =
      quadrature_transform(basis, tensor_gauss(basis.germs(), {5, 5, 4}, 0.0));
  const Matrix identity = Matrix::Identity(basis.size(), basis.size());
  EXPECT_LT((tensor.forward * tensor.backward - identity).cwiseAbs().maxCoeff(), 1e-12);
  const ColumnTransform sparse = quadrature_transform(basis, smolyak(basis.germs(), 4, 0.0));
  EXPECT_LT((sparse.forward * sparse.backward - identity).cwiseAbs().maxCoeff(), 1e-11);
}

}  // namespace latin::stochastic
