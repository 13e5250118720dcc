#include <gtest/gtest.h>

#include "stochastic/germ.hpp"
#include "stochastic_sample.hpp"

namespace latin::stochastic {

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

TEST(Germ, AnAtomFarFromTheOthersKeepsItsWeight) {
  // what a germ of observed values with an outlier is: the recurrence of its polynomials runs away at the outlier
  const Index count = 500;
  Vector nodes(count + 1);
  for (Index i = 0; i < count; ++i) {
    const double x = -1.0 + (2.0 * static_cast<double>(i) + 1.0) / static_cast<double>(count);
    nodes(i) = x * (1.0 + 0.3 * x * x);
  }
  for (const double away : {20.0, 400.0, 1e6}) {
    nodes(count) = away;
    const Germ germ = Germ::from_measure(nodes, Vector::Ones(count + 1));
    for (const Index points : {6, 16, 30}) {
      const Rule rule = germ.gauss(points);
      EXPECT_NEAR(rule.points(points - 1, 0), away, 1e-12 * away);
      EXPECT_NEAR(rule.weights(points - 1) * static_cast<double>(count + 1), 1.0, 1e-10);
      const Matrix psi = germ.evaluate(rule.points.col(0), 2);
      const Matrix gram = psi.transpose() * rule.weights.asDiagonal() * psi;
      EXPECT_LT((gram - Matrix::Identity(3, 3)).cwiseAbs().maxCoeff(), 1e-9)
          << away << " " << points;
    }
  }
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

}  // namespace latin::stochastic
