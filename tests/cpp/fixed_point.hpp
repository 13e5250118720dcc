#pragma once

#include <Eigen/Dense>
#include <random>

#include "iteration/step.hpp"
#include "latin/common/types.hpp"
#include "latin/iteration/state.hpp"

/// A fixed point without any structure: s = M s + b, so that r = (M - 1) s + b, with the traces w = T s.
namespace fixed_point {

using latin::ConstMatrixRef;
using latin::Index;
using latin::Matrix;
using latin::Vector;

inline Matrix random(Index rows, Index cols, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  return Matrix::NullaryExpr(rows, cols, [&] { return uniform(generator); });
}

/// Positive weights, far from equal.
inline Vector weights(Index rows) { return Vector::LinSpaced(rows, 0.2, 3.0); }

struct Linear {
  Index rows = 6;
  Matrix map = 0.4 * random(6, 6, 1);
  Matrix constant = random(6, 1, 2);
  Matrix trace = random(6, 6, 3);

  [[nodiscard]] Matrix residual(ConstMatrixRef data) const {
    return map * data - data + constant.replicate(1, data.cols() / constant.cols());
  }
  [[nodiscard]] Matrix solution() const {
    return (Matrix::Identity(rows, rows) - map).partialPivLu().solve(constant);
  }
  [[nodiscard]] latin::iteration::FixedPoint stages() const {
    return {[this](Matrix& /*step*/, Matrix& data, Matrix& traces) { traces = trace * data; },
            [this](const Matrix& data, const Matrix& /*traces*/, Matrix& residual) {
              residual = this->residual(data);
            },
            {}};
  }
  [[nodiscard]] latin::iteration::State state(ConstMatrixRef data) const {
    return {data, trace * data};
  }
};

}  // namespace fixed_point
