#include <gtest/gtest.h>

#include "stochastic/galerkin.hpp"
#include "stochastic/quadrature.hpp"
#include "stochastic_sample.hpp"

namespace latin::stochastic {

TEST(Galerkin, MatrixEqualsBruteForceQuadrature) {
  const ChaosBasis basis(mixed_germs(), mixed_set());
  IndexRequest request = total(3, 3);
  const MultiIndexSet property(request);
  const Vector coefficients = Vector::LinSpaced(property.size(), 1.0, 2.0).array() *
                              Vector::LinSpaced(property.size(), 3.0, -1.0).array();
  const Matrix found = galerkin_matrix(basis, coefficients, property);

  const Rule rule = tensor_gauss(basis.germs(), {8, 8, 4}, 0.0);
  const Matrix psi = basis.evaluate(rule.points);
  const Vector values = ChaosBasis(mixed_germs(), property).evaluate(rule.points) * coefficients;
  const Matrix expected = psi.transpose() * rule.weights.cwiseProduct(values).asDiagonal() * psi;
  EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), 1e-12 * expected.cwiseAbs().maxCoeff());
}

TEST(Galerkin, HermiteTripleProductsInClosedForm) {
  const Germ hermite = Germ::family("hermite", {});
  const std::vector<Matrix> tables = triple_products(hermite, 12, 6);
  ASSERT_EQ(tables.size(), 13U);
  const auto factorial = [](int n) { return std::tgamma(n + 1.0); };
  for (int i = 0; i <= 12; ++i) {
    for (int j = 0; j <= 6; ++j) {
      for (int k = 0; k <= 6; ++k) {
        const int s = (i + j + k) / 2;
        const bool zero = (i + j + k) % 2 == 1 || s < i || s < j || s < k;
        const double expected = zero ? 0.0
                                     : std::sqrt(factorial(i) * factorial(j) * factorial(k)) /
                                           (factorial(s - i) * factorial(s - j) * factorial(s - k));
        const double found = tables[static_cast<std::size_t>(i)](j, k);
        if (zero) {
          EXPECT_EQ(found, 0.0);
        } else {
          EXPECT_NEAR(found / expected, 1.0, 1e-12) << i << j << k;
        }
      }
    }
  }
}

TEST(Galerkin, CriticalCoefficientOfVariation) {
  const Germ hermite = Germ::family("hermite", {});
  // order, 1 / greatest root of He_{order+1}
  const std::vector<std::pair<Index, double>> table{
      {2, .57735}, {3, .42837}, {4, .35002}, {5, .30082},  {6, .26664},
      {7, .24128}, {8, .22159}, {9, .20578}, {10, .19275}, {12, .17241}};
  for (const auto& [order, expected] : table) {
    const double critical = critical_cov(hermite, order);
    EXPECT_NEAR(critical, expected, 5.1e-6) << order;
    // and the eigenvalues of 1 + d xi say the same on both sides
    const ChaosBasis basis({hermite}, MultiIndexSet(total(1, order)));
    const Vector near{{1.0, critical * (1.0 - 1e-6)}};
    const Vector beyond{{1.0, critical * (1.0 + 1e-6)}};
    const MultiIndexSet affine(total(1, 1));
    EXPECT_GT(smallest_eigenvalue(galerkin_matrix(basis, near, affine)), 0.0);
    EXPECT_LT(smallest_eigenvalue(galerkin_matrix(basis, beyond, affine)), 0.0);
  }
  EXPECT_TRUE(std::isinf(critical_cov(hermite, 0)));
  // uniform: the law itself turns negative at 1 / sqrt(3), which no order passes
  const Germ legendre = Germ::family("legendre", {});
  EXPECT_GT(critical_cov(legendre, 20), 1.0 / std::sqrt(3.0));
  EXPECT_NEAR(critical_cov(legendre, 20), 1.0 / std::sqrt(3.0), 5e-3);
}

TEST(Galerkin, MeanOfTheInverseIsTheGaussValue) {
  const Germ hermite = Germ::family("hermite", {});
  const std::vector<std::pair<Index, double>> table{
      {2, 1.04545455}, {3, 1.04602510}, {4, 1.04615385}};
  for (const auto& [order, expected] : table) {
    const ChaosBasis basis({hermite}, MultiIndexSet(total(1, order)));
    const Matrix a = galerkin_matrix(basis, Vector{{1.0, 0.2}}, MultiIndexSet(total(1, 1)));
    const Vector u = a.ldlt().solve(Vector::Unit(order + 1, 0));
    EXPECT_NEAR(u(0), expected, 1e-8);
  }
}

TEST(Galerkin, UncoupledModesAreSeparated) {
  const ChaosBasis basis({Germ::family("hermite", {}), Germ::family("hermite", {})},
                         MultiIndexSet(total(2, 3)));
  const auto blocks = coupled_blocks(matrix_of_germ(basis, 0));
  // one chain for each degree 0 .. 3 of the other variable
  ASSERT_EQ(blocks.size(), 4U);
  const Vector nodes = basis.germs()[0].gauss(4).points.col(0);
  EXPECT_NEAR(smallest_eigenvalue(matrix_of_germ(basis, 0)), nodes(0), 1e-13);
}

}  // namespace latin::stochastic
