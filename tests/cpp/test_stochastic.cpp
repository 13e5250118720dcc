#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <string>

#include "latin/common/error.hpp"
#include "latin/stochastic/basis.hpp"
#include "latin/stochastic/galerkin.hpp"
#include "latin/stochastic/quadrature.hpp"
#include "latin/stochastic/statistics.hpp"
#include "latin/stochastic/transform.hpp"

namespace {

using latin::Index;
using latin::InputError;
using latin::Matrix;
using latin::NumericalError;
using latin::SparseColumns;
using latin::Vector;
using namespace latin::stochastic;

std::vector<Germ> every_germ() {
  const Vector nodes = Vector::LinSpaced(60, -1.0, 2.0).array().square() + 0.1;
  const Vector shifted = nodes + Vector::LinSpaced(60, 0.0, 3.0);
  return {Germ::family("hermite", {}),
          Germ::family("legendre", {}),
          Germ::family("laguerre", std::vector{25.0}),
          Germ::family("laguerre", std::vector{0.5}),
          Germ::family("jacobi", std::vector{2.0, 3.5}),
          Germ::family("jacobi", std::vector{0.5, 0.5}),
          Germ::family("jacobi", std::vector{1.0, 1.0}),
          Germ::from_measure(shifted, Vector::LinSpaced(60, 1.0, 2.0))};
}

IndexRequest total(Index dimension, Index order) {
  return {IndexShape::total, dimension, order, 1.0, {}, 0, {}, 0.0, 0.0};
}

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "nothing was thrown";
}

void expect_mentions(const std::function<void()>& action, const std::vector<std::string>& words) {
  const std::string message = message_of(action);
  for (const std::string& word : words) {
    EXPECT_NE(message.find(word), std::string::npos) << message << "\n lacks: " << word;
  }
}

// --- germs -----------------------------------------------------------------------------------

TEST(Germ, PolynomialsAreOrthonormal) {
  for (const Germ& germ : every_germ()) {
    for (const Index degree : {0, 1, 7, 20}) {
      const Rule rule = germ.gauss(degree + 1);
      const Matrix psi = germ.evaluate(rule.points.col(0), degree);
      const Matrix gram = psi.transpose() * rule.weights.asDiagonal() * psi;
      // unevenly spaced atoms: some nodes of the rule are close to each other
      const double tolerance = germ.capacity() == Germ::unlimited ? 1e-13 : 1e-12;
      EXPECT_LT((gram - Matrix::Identity(degree + 1, degree + 1)).cwiseAbs().maxCoeff(), tolerance)
          << germ.name() << " degree " << degree;
    }
  }
}

TEST(Germ, GaussIsExactForMomentsInClosedForm) {
  const auto moment = [](const Germ& germ, Index points, int power) {
    const Rule rule = germ.gauss(points);
    return (rule.weights.array() * rule.points.col(0).array().pow(power)).sum();
  };
  double normal = 1.0;
  double gamma = 1.0;
  for (int n = 1; n <= 6; ++n) {
    normal *= 2 * n - 1;
    EXPECT_NEAR(moment(Germ::family("hermite", {}), 7, 2 * n) / normal, 1.0, 1e-13);
    EXPECT_NEAR(moment(Germ::family("legendre", {}), 7, 2 * n) * (2 * n + 1), 1.0, 1e-13);
    gamma *= 3.5 + n - 1;
    EXPECT_NEAR(moment(Germ::family("laguerre", std::vector{3.5}), 4, n) / gamma, 1.0, 1e-13);
  }
  // beta(2, 3.5) on [0, 1]: mean 2 / 5.5, variance 7 / (5.5^2 6.5)
  const Germ beta = Germ::family("jacobi", std::vector{2.0, 3.5});
  EXPECT_NEAR(moment(beta, 3, 1), 2.0 * 2.0 / 5.5 - 1.0, 1e-14);
  EXPECT_NEAR(moment(beta, 3, 2) - std::pow(moment(beta, 3, 1), 2), 4.0 * 7.0 / (5.5 * 5.5 * 6.5),
              1e-14);
}

TEST(Germ, JacobiOfOneAndOneIsLegendre) {
  const Recurrence jacobi = Germ::family("jacobi", std::vector{1.0, 1.0}).recurrence(30);
  const Recurrence legendre = Germ::family("legendre", {}).recurrence(30);
  EXPECT_LT((jacobi.alpha - legendre.alpha).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_LT((jacobi.beta - legendre.beta).cwiseAbs().maxCoeff(), 1e-14);
}

TEST(Germ, LanczosOfAGaussRuleGivesItsRecurrenceBack) {
  for (const char* name : {"hermite", "legendre"}) {
    const Germ germ = Germ::family(name, {});
    const Rule rule = germ.gauss(40);
    const Recurrence found = Germ::from_measure(rule.points.col(0), rule.weights).recurrence(25);
    const Recurrence exact = germ.recurrence(25);
    EXPECT_LT((found.alpha - exact.alpha).cwiseAbs().maxCoeff(), 1e-12) << name;
    EXPECT_LT((found.beta - exact.beta).cwiseAbs().maxCoeff(), 1e-12) << name;
  }
}

TEST(Germ, DiscreteMeasureIsItsOwnGaussRule) {
  const Vector nodes{{3.0, -1.0, 3.0, 0.5, 7.0}};
  const Vector weights{{1.0, 2.0, 1.0, 4.0, 0.0}};
  const Germ germ = Germ::from_measure(nodes, weights);
  ASSERT_EQ(germ.capacity(), 3);
  const Rule rule = germ.gauss(3);
  EXPECT_LT((rule.points.col(0) - Vector{{-1.0, 0.5, 3.0}}).cwiseAbs().maxCoeff(), 1e-14);
  EXPECT_LT((rule.weights - Vector{{0.25, 0.5, 0.25}}).cwiseAbs().maxCoeff(), 1e-14);
}

TEST(Germ, GreatOrdersStayFinite) {
  for (const Germ& germ : every_germ()) {
    const Rule rule = germ.gauss(std::min<Index>(germ.capacity(), 200));
    EXPECT_TRUE(rule.points.allFinite() && rule.weights.allFinite()) << germ.name();
    EXPECT_GE(rule.weights.minCoeff(), 0.0) << germ.name();
    EXPECT_NEAR(rule.weights.sum(), 1.0, 1e-14) << germ.name();
  }
}

TEST(Germ, BadInputIsNamed) {
  expect_mentions([] { static_cast<void>(Germ::family("hermit", {})); },
                  {"'hermit'", "hermite, jacobi, laguerre, legendre"});
  expect_mentions([] { static_cast<void>(Germ::family("laguerre", std::vector{-1.0})); },
                  {"laguerre", "-1", "positive"});
  expect_mentions([] { static_cast<void>(Germ::family("laguerre", {})); }, {"laguerre", "1", "0"});
  const Germ three = Germ::from_measure(Vector{{1.0, 2.0, 4.0}}, Vector::Ones(3));
  expect_mentions([&] { static_cast<void>(three.gauss(4)); }, {"measure of 3 atoms", "0 to 2"});
  EXPECT_THROW(static_cast<void>(Germ::from_measure(Vector::Zero(2), Vector{{1.0, -1.0}})),
               InputError);
  EXPECT_THROW(static_cast<void>(Germ::from_measure(Vector::Zero(2), Vector::Zero(2))), InputError);
  EXPECT_THROW(static_cast<void>(Germ::from_measure(Vector::Zero(2), Vector::Ones(3))), InputError);
  EXPECT_THROW(static_cast<void>(Germ::from_recurrence({Vector::Zero(2), Vector::Zero(2)})),
               InputError);
  EXPECT_THROW(static_cast<void>(three.gauss(0)), InputError);
  const Vector close{{0.0, 1e-13, 1.0}};
  EXPECT_THROW(static_cast<void>(Germ::from_measure(close, Vector::Ones(3)).gauss(3)),
               NumericalError);
}

// --- multi-indices ---------------------------------------------------------------------------

TEST(MultiIndexSet, TotalDegreeInGradedOrder) {
  const MultiIndexSet set(total(2, 2));
  IndexTable expected(6, 2);
  expected << 0, 0, 1, 0, 0, 1, 2, 0, 1, 1, 0, 2;
  EXPECT_EQ(set.table(), expected);
  for (Index row = 0; row < set.size(); ++row) {
    EXPECT_EQ(set.find(set[row]), row);
  }
  EXPECT_FALSE(set.find(std::vector{2, 1}).has_value());
}

TEST(MultiIndexSet, CountsAgreeWithEnumeration) {
  for (const Index dimension : {0, 1, 3, 5}) {
    for (const Index order : {0, 1, 4}) {
      for (const IndexShape shape :
           {IndexShape::total, IndexShape::tensor, IndexShape::hyperbolic}) {
        for (const Index interaction : {0, 1, 2}) {
          const IndexRequest request{shape, dimension, order, 0.5, {}, interaction, {}, 0.0, 0.0};
          const MultiIndexSet set(request);
          EXPECT_EQ(static_cast<double>(set.size()), MultiIndexSet::count(request, 1e9));
          // by the definition, over the whole box
          const auto box = static_cast<Index>(
              std::pow(static_cast<double>(order + 1), static_cast<double>(dimension)));
          Index members = 0;
          for (Index code = 0; code < box; ++code) {
            Index rest = code;
            Index sum = 0;
            Index active = 0;
            double norm = 0.0;
            for (Index l = 0; l < dimension; ++l) {
              const Index degree = rest % (order + 1);
              rest /= order + 1;
              sum += degree;
              active += degree > 0 ? 1 : 0;
              norm += std::sqrt(static_cast<double>(degree));
            }
            const bool in = shape == IndexShape::total ? sum <= order
                            : shape == IndexShape::tensor
                                ? true
                                : norm * norm <= static_cast<double>(order) + 1e-9;
            members += in && (interaction == 0 || active <= interaction) ? 1 : 0;
          }
          EXPECT_EQ(set.size(), members) << dimension << " " << order;
        }
      }
    }
  }
  EXPECT_EQ(MultiIndexSet(total(10, 3)).size(), 286);
}

TEST(MultiIndexSet, WeightsAndCapsLimitDegrees) {
  IndexRequest request = total(2, 4);
  request.weights = {1.0, 2.0};
  const MultiIndexSet weighted(request);
  EXPECT_EQ(weighted.degree(0), 4);
  EXPECT_EQ(weighted.degree(1), 2);
  EXPECT_EQ(weighted.size(), 9);
  request.weights.clear();
  request.caps = {4, 1};
  EXPECT_EQ(MultiIndexSet(request).size(), 9);
}

TEST(MultiIndexSet, SizeIsRefusedBeforeAllocation) {
  IndexRequest request = total(20, 30);
  request.memory_limit = 1e9;
  request.bytes_per_index = 8.0;
  expect_mentions([&] { const MultiIndexSet set(request); },
                  {"order 30", "20 variables", "4.71292e+13", "GB", "limit of 1 GB"});
  request.shape = IndexShape::hyperbolic;
  request.q = 0.9;
  request.memory_limit = 1e6;
  expect_mentions([&] { const MultiIndexSet set(request); }, {"or more", "limit of 1 MB"});
  request = total(2000, 1000);  // more than a double can count
  expect_mentions([&] { const MultiIndexSet set(request); }, {"inf"});
}

TEST(MultiIndexSet, BadInputIsNamed) {
  expect_mentions([] { const MultiIndexSet set(total(2, -1)); }, {"-1", ">= 0"});
  expect_mentions([] { static_cast<void>(index_shape("totl")); }, {"'totl'", "total"});
  IndexRequest request = total(2, 2);
  request.weights = {1.0};
  EXPECT_THROW(const MultiIndexSet set(request), InputError);
  request.weights = {1.0, 0.0};
  EXPECT_THROW(const MultiIndexSet set(request), InputError);
  request = {IndexShape::hyperbolic, 2, 2, 1.5, {}, 0, {}, 0.0, 0.0};
  EXPECT_THROW(const MultiIndexSet set(request), InputError);
  IndexTable rows(2, 1);
  rows << 0, 0;
  EXPECT_THROW(const MultiIndexSet set(rows), InputError);
  rows << 1, 2;
  EXPECT_THROW(const MultiIndexSet set(rows), InputError);
  rows << 0, -1;
  EXPECT_THROW(const MultiIndexSet set(rows), InputError);
}

// --- bases and Galerkin matrices --------------------------------------------------------------

std::vector<Germ> mixed_germs() {
  return {Germ::family("hermite", {}), Germ::family("laguerre", std::vector{4.0}),
          Germ::from_measure(Vector{{0.0, 1.0, 2.5, 4.0}}, Vector{{1.0, 2.0, 2.0, 1.0}})};
}

MultiIndexSet mixed_set() {
  IndexRequest request = total(3, 4);
  request.caps = {4, 4, 3};
  return MultiIndexSet(request);
}

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

TEST(Galerkin, GermMatrixIsTheMatrixOfTheGerm) {
  const ChaosBasis basis(mixed_germs(), mixed_set());
  for (Index l = 0; l < 3; ++l) {
    const Recurrence recurrence = basis.recurrence(l);
    IndexRequest request = total(3, 1);
    const MultiIndexSet property(request);  // 1, xi_0, xi_1, xi_2
    Vector coefficients = Vector::Zero(4);
    coefficients(0) = recurrence.alpha(0);
    coefficients(l + 1) = recurrence.beta(1);
    const Matrix difference =
        Matrix(galerkin_matrix(basis, coefficients, property)) - Matrix(germ_matrix(basis, l));
    EXPECT_LT(difference.cwiseAbs().maxCoeff(), 1e-12);
  }
  EXPECT_THROW(static_cast<void>(germ_matrix(basis, 3)), InputError);
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
  const auto blocks = coupled_blocks(germ_matrix(basis, 0));
  // one chain for each degree 0 .. 3 of the other variable
  ASSERT_EQ(blocks.size(), 4U);
  const Vector nodes = basis.germs()[0].gauss(4).points.col(0);
  EXPECT_NEAR(smallest_eigenvalue(germ_matrix(basis, 0)), nodes(0), 1e-13);
}

// --- transforms ------------------------------------------------------------------------------

TEST(ColumnTransform, GalerkinDiagonalisesExactly) {
  const ChaosBasis basis(mixed_germs(), mixed_set());
  const SparseColumns a = germ_matrix(basis, 1);
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

TEST(Quadrature, SparseRuleIsSmallAndExact) {
  const std::vector<Germ> germs(5, Germ::family("hermite", {}));
  const Rule sparse = smolyak(germs, 3, 0.0);
  EXPECT_NEAR(sparse.weights.sum(), 1.0, 1e-12);
  EXPECT_LT(sparse.weights.size(), 1024);  // 4^5 for the tensor rule
  // E[x0^2 x1^2 x2^2] = 1 and E[x0^6] = 15: total degree 6 <= 7
  const auto x = sparse.points.array();
  EXPECT_NEAR((sparse.weights.array() * (x.col(0) * x.col(1) * x.col(2)).square()).sum(), 1.0,
              1e-11);
  EXPECT_NEAR((sparse.weights.array() * x.col(4).pow(6)).sum(), 15.0, 1e-10);
  EXPECT_THROW(static_cast<void>(smolyak(germs, -1, 0.0)), InputError);
  expect_mentions([&] { static_cast<void>(tensor_gauss(germs, {100, 100, 100, 100, 100}, 1e9)); },
                  {"tensor", "480", "GB"});
  EXPECT_THROW(static_cast<void>(tensor_gauss(germs, {1, 1, 1, 1, 0}, 0.0)), InputError);
}

// --- answers ---------------------------------------------------------------------------------

TEST(Statistics, SobolIndicesOfAPolynomial) {
  // 3 + 2 x0 + x1 + (x0^2 - 1) + x0 x1 in normal germs: variance 4 + 1 + 2 + 1
  const MultiIndexSet set(total(2, 2));
  Matrix coefficients = Matrix::Zero(2, 6);
  coefficients.row(0) << 3.0, 2.0, 1.0, std::sqrt(2.0), 1.0, 0.0;
  EXPECT_DOUBLE_EQ(mean(coefficients)(0), 3.0);
  EXPECT_NEAR(variance(coefficients)(0), 8.0, 1e-14);
  const Matrix first = sobol_first(coefficients, set);
  const Matrix whole = sobol_total(coefficients, set);
  EXPECT_NEAR(first(0, 0), 6.0 / 8.0, 1e-15);
  EXPECT_NEAR(first(0, 1), 1.0 / 8.0, 1e-15);
  EXPECT_NEAR(whole(0, 0), 7.0 / 8.0, 1e-15);
  EXPECT_NEAR(whole(0, 1), 2.0 / 8.0, 1e-15);
  EXPECT_NEAR(sobol_closed(coefficients, set, {0, 1})(0), 1.0, 1e-15);
  EXPECT_NEAR(sobol_closed(coefficients, set, {0})(0), first(0, 0), 1e-15);
  EXPECT_EQ(sobol_closed(coefficients, set, {})(0), 0.0);
  const Matrix degrees = variance_by_degree(coefficients, set);
  EXPECT_NEAR(degrees(0, 1), 5.0, 1e-14);
  EXPECT_NEAR(degrees(0, 2), 3.0, 1e-14);
  EXPECT_TRUE(std::isnan(first(1, 0)) && std::isnan(whole(1, 1)));
  EXPECT_THROW(static_cast<void>(sobol_first(Matrix::Zero(1, 5), set)), InputError);
  EXPECT_THROW(static_cast<void>(sobol_closed(coefficients, set, {2})), InputError);
}

}  // namespace
