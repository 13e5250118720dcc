#include <gtest/gtest.h>

#include "stochastic/statistics.hpp"
#include "stochastic_sample.hpp"

namespace latin::stochastic {

TEST(Statistics, SobolIndicesOfAPolynomial) {
  // 3 + 2 x0 + x1 + (x0^2 - 1) + x0 x1 in normal germs: variance 4 + 1 + 2 + 1
  const MultiIndexSet set(total(2, 2));
  Matrix coefficients = Matrix::Zero(2, 6);
  coefficients.row(0) << 3.0, 2.0, 1.0, std::sqrt(2.0), 1.0, 0.0;
  EXPECT_NEAR(variance(coefficients)(0), 8.0, 1e-14);
  EXPECT_NEAR(sobol_closed(coefficients, set, {0, 1})(0), 1.0, 1e-15);
  EXPECT_NEAR(sobol_closed(coefficients, set, {0})(0), 6.0 / 8.0, 1e-15);
  EXPECT_NEAR(sobol_closed(coefficients, set, {1})(0), 1.0 / 8.0, 1e-15);
  EXPECT_EQ(sobol_closed(coefficients, set, {})(0), 0.0);
  EXPECT_TRUE(std::isnan(sobol_closed(coefficients, set, {0})(1)));
  EXPECT_THROW(static_cast<void>(sobol_closed(Matrix::Zero(1, 5), set, {0})), InputError);
  EXPECT_THROW(static_cast<void>(sobol_closed(coefficients, set, {2})), InputError);
}

}  // namespace latin::stochastic
