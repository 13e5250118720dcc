#include "stochastic/basis.hpp"

#include <algorithm>
#include <utility>

#include "latin/common/error.hpp"

namespace latin::stochastic {

ChaosBasis::ChaosBasis(std::vector<Germ> germs, MultiIndexSet indices)
    : germs_(std::move(germs)), indices_(std::move(indices)) {
  if (static_cast<Index>(germs_.size()) != dimension()) {
    throw InputError("a chaos basis of " + std::to_string(dimension()) +
                     " variables needs as many germs; got " + std::to_string(germs_.size()));
  }
  for (Index l = 0; l < dimension(); ++l) {
    const Germ& germ = germs_[static_cast<std::size_t>(l)];
    const Index degree = indices_.degree(l);
    if (degree >= germ.capacity()) {
      throw InputError("variable " + std::to_string(l) + ", germ '" + germ.name() + "': degree " +
                       std::to_string(degree) +
                       " is asked for; it has polynomials of degree 0 to " +
                       std::to_string(germ.capacity() - 1));
    }
    recurrences_.push_back(germ.recurrence(std::min(degree + 2, germ.capacity())));
  }
}

Matrix ChaosBasis::evaluate(ConstMatrixRef points) const {
  if (points.cols() != dimension()) {
    throw InputError("points of a chaos in " + std::to_string(dimension()) +
                     " variables have that many columns; got " + std::to_string(points.cols()));
  }
  Matrix result = Matrix::Ones(points.rows(), size());
  for (Index l = 0; l < dimension(); ++l) {
    const Matrix psi = stochastic::evaluate(recurrence(l), points.col(l), indices_.degree(l));
    for (Index i = 0; i < size(); ++i) {
      const int degree = indices_.table()(i, l);
      if (degree > 0) {
        result.col(i).array() *= psi.col(degree).array();
      }
    }
  }
  return result;
}

Matrix ChaosBasis::evaluate(ConstMatrixRef coefficients, ConstMatrixRef points) const {
  if (coefficients.cols() != size()) {
    throw InputError("coefficients in a chaos of " + std::to_string(size()) +
                     " modes have that many columns; got " + std::to_string(coefficients.cols()));
  }
  return coefficients * evaluate(points).transpose();
}

}  // namespace latin::stochastic
