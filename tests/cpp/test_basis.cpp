#include <gtest/gtest.h>

#include "stochastic/basis.hpp"
#include "stochastic/quadrature.hpp"
#include "stochastic_sample.hpp"

namespace latin::stochastic {

TEST(ChaosBasis, IsOrthonormalInSeveralVariables) {
  const ChaosBasis basis(mixed_germs(), mixed_set());
  const Rule rule = tensor_gauss(basis.germs(), {5, 5, 4}, 0.0);
  const Matrix psi = basis.evaluate(rule.points);
  const Matrix gram = psi.transpose() * rule.weights.asDiagonal() * psi;
  EXPECT_LT((gram - Matrix::Identity(basis.size(), basis.size())).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(ChaosBasis, RefusesDegreesThatAGermDoesNotHave) {
  expect_mentions([] { const ChaosBasis basis(mixed_germs(), MultiIndexSet(total(3, 4))); },
                  {"variable 2", "degree 4", "0 to 3"});
  EXPECT_THROW(const ChaosBasis basis(mixed_germs(), MultiIndexSet(total(2, 1))), InputError);
  const ChaosBasis basis(mixed_germs(), mixed_set());
  EXPECT_THROW(static_cast<void>(basis.evaluate(Matrix::Zero(4, 2))), InputError);
}

}  // namespace latin::stochastic
