#pragma once

#include <cmath>
#include <functional>
#include <span>
#include <utility>

#include "latin/common/types.hpp"

namespace latin::iteration {

/// Sums numbers over the ranks, in place. Collective.
using Reducer = std::function<void(std::span<double>)>;

/// What data and residuals are measured with: one weight a row (W/k), summed over columns and ranks.
class Metric {
 public:
  /// @param sum empty: there is one rank
  explicit Metric(Vector weights, Reducer sum = {})
      : weights_(std::move(weights)), sum_(std::move(sum)) {}

  [[nodiscard]] const Vector& weights() const { return weights_; }
  void sum(std::span<double> values) const {
    if (sum_) {
      sum_(values);
    }
  }
  /// This rank's share of the squared norm of a block (rows, c).
  [[nodiscard]] double share_of_square(ConstMatrixRef block) const {
    double sum = 0.0;
    for (Index column = 0; column < block.cols(); ++column) {
      sum += block.col(column).cwiseAbs2().dot(weights_);
    }
    return sum;
  }
  /// Collective.
  [[nodiscard]] double norm(ConstMatrixRef block) const {
    double square = share_of_square(block);
    sum({&square, 1});
    return std::sqrt(square);
  }

 private:
  Vector weights_;
  Reducer sum_;
};

}  // namespace latin::iteration
