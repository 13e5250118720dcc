#pragma once

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <string>
#include <vector>

#include "latin/common/error.hpp"
#include "stochastic/basis.hpp"
#include "stochastic/galerkin.hpp"
#include "stochastic/germ.hpp"
#include "stochastic/multi_index.hpp"

/// Germs and index sets that the tests of the stochastic classes share.
namespace latin::stochastic {

inline std::vector<Germ> every_germ() {
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

inline IndexRequest total(Index dimension, Index order) {
  return {IndexShape::total, dimension, order, 1.0, {}, 0, {}, 0.0, 0.0};
}

inline std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "nothing was thrown";
}

inline void expect_mentions(const std::function<void()>& action,
                            const std::vector<std::string>& words) {
  const std::string message = message_of(action);
  for (const std::string& word : words) {
    EXPECT_NE(message.find(word), std::string::npos) << message << "\n lacks: " << word;
  }
}

inline std::vector<Germ> mixed_germs() {
  return {Germ::family("hermite", {}), Germ::family("laguerre", std::vector{4.0}),
          Germ::from_measure(Vector{{0.0, 1.0, 2.5, 4.0}}, Vector{{1.0, 2.0, 2.0, 1.0}})};
}

inline MultiIndexSet mixed_set() {
  IndexRequest request = total(3, 4);
  request.caps = {4, 4, 3};
  return MultiIndexSet(request);
}

/// Galerkin matrix of germ l itself, not standardised.
inline SparseColumns matrix_of_germ(const ChaosBasis& basis, Index l) {
  const MultiIndexSet property(total(basis.dimension(), 1));  // 1, xi_0, xi_1, ...
  Vector coefficients = Vector::Zero(property.size());
  coefficients(0) = basis.recurrence(l).alpha(0);
  coefficients(l + 1) = basis.recurrence(l).beta(1);
  return galerkin_matrix(basis, coefficients, property);
}

}  // namespace latin::stochastic
