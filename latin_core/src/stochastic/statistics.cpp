#include "stochastic/statistics.hpp"

#include <limits>

#include "latin/common/error.hpp"

namespace latin::stochastic {

namespace {

void check(ConstMatrixRef coefficients, const MultiIndexSet& indices) {
  if (coefficients.cols() != indices.size()) {
    throw InputError("coefficients in a chaos of " + std::to_string(indices.size()) +
                     " modes have that many columns; got " + std::to_string(coefficients.cols()));
  }
}

/// (rows, mask columns) sums of squares of the modes that a 0/1 mask (modes, columns) takes, over
/// the variance.
Matrix shares(ConstMatrixRef coefficients, const Matrix& mask) {
  const Vector total = variance(coefficients);
  Matrix result = coefficients.cwiseAbs2() * mask;
  for (Index row = 0; row < result.rows(); ++row) {
    if (total(row) > 0.0) {
      result.row(row) /= total(row);
    } else {
      result.row(row).setConstant(std::numeric_limits<double>::quiet_NaN());
    }
  }
  return result;
}

}  // namespace

Vector variance(ConstMatrixRef coefficients) {
  if (coefficients.cols() < 1) {
    throw InputError("a chaos has at least one mode; got coefficients without columns");
  }
  return coefficients.rightCols(coefficients.cols() - 1).rowwise().squaredNorm();
}

Vector sobol_closed(ConstMatrixRef coefficients, const MultiIndexSet& indices,
                    const std::vector<Index>& group) {
  check(coefficients, indices);
  Eigen::RowVectorXi outside = Eigen::RowVectorXi::Ones(indices.dimension());
  for (const Index variable : group) {
    if (variable < 0 || variable >= indices.dimension()) {
      throw InputError("variable " + std::to_string(variable) + " of a chaos in " +
                       std::to_string(indices.dimension()) + " variables (counted from 0)");
    }
    outside(variable) = 0;
  }
  Matrix mask = Matrix::Zero(indices.size(), 1);
  for (Index i = 1; i < indices.size(); ++i) {
    mask(i, 0) = indices.table().row(i).dot(outside) == 0 ? 1.0 : 0.0;
  }
  return shares(coefficients, mask);
}

}  // namespace latin::stochastic
