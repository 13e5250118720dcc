#pragma once

#include <Eigen/Core>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <string>

#include "latin/common/error.hpp"
#include "latin/common/types.hpp"

namespace latin {

/// `a.maxCoeff<keep_nan>()` keeps a NaN, as do the maxima here, of errors, sizes and whatever decides: those of the
/// standard library and of Eigen drop one, depending on the order, and what is no number is then taken for a small one.
inline constexpr int keep_nan = Eigen::PropagateNaN;

[[nodiscard]] inline double larger(double a, double b) { return std::isnan(a) || a > b ? a : b; }

/// The same of all entries.
template <class A, class B>
[[nodiscard]] typename A::PlainObject larger(const Eigen::MatrixBase<A>& a,
                                             const Eigen::MatrixBase<B>& b) {
  return a.binaryExpr(b, [](double one, double other) { return larger(one, other); });
}
template <class A>
[[nodiscard]] typename A::PlainObject larger(const Eigen::MatrixBase<A>& a, double least) {
  return a.unaryExpr([least](double one) { return larger(one, least); });
}

/// The same of those of a range; `least` of an empty one.
template <class Numbers>
[[nodiscard]] double largest_of(const Numbers& numbers, double least) {
  for (const double number : numbers) {
    least = larger(least, number);
  }
  return least;
}
[[nodiscard]] inline double largest_of(std::initializer_list<double> numbers) {
  return largest_of(numbers, -std::numeric_limits<double>::infinity());
}

/// The number of entries of a sparse matrix, whose indices have 32 bits.
/// @param what is named
/// @throws NumericalError if these cannot count them
inline int count_of_entries(Index count, const std::string& what) {
  if (count < 0 || count > std::numeric_limits<int>::max()) {
    throw NumericalError(
        what + " has " + std::to_string(count) +
        " entries, more than indices of 32 bits can count: use a coarser mesh, smaller parts or "
        "backend 'multigrid'");
  }
  return static_cast<int>(count);
}

}  // namespace latin
