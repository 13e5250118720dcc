#include <gtest/gtest.h>

#include "stochastic/quadrature.hpp"
#include "stochastic_sample.hpp"

namespace latin::stochastic {

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

}  // namespace latin::stochastic
