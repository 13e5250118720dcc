#include "algebra/trailing.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <utility>

#include "latin/common/error.hpp"

namespace latin::algebra {

ChangedTrailing::ChangedTrailing(std::shared_ptr<const Factor> first, const SparseRows& change,
                                 const std::string& name)
    : first_(std::move(first)) {
  const Matrix lower = first_->trailing_factor().triangularView<Eigen::Lower>();
  Matrix sum = Matrix::Zero(lower.rows(), lower.cols());
  sum.selfadjointView<Eigen::Lower>().rankUpdate(lower);
  for (Index row = 0; row < change.outerSize(); ++row) {
    for (SparseRows::InnerIterator it(change, row); it; ++it) {
      if (it.col() <= row) {
        sum(row, it.col()) += it.value();
      }
    }
  }
  const Vector diagonal = sum.diagonal();
  const Eigen::LLT<Eigen::Ref<Matrix>> factor(sum);
  if (!is_definite(factor, diagonal)) {
    throw NumericalError("the stiffness of '" + name +
                         "' is not positive definite with its changed interfaces");
  }
  changed_ = sum.triangularView<Eigen::Lower>();
}

Matrix ChangedTrailing::forward(ConstMatrixRef rhs) const {
  Matrix partial = first_->forward(rhs);
  auto own = partial.bottomRows(changed_.rows());
  own = (first_->trailing_factor().triangularView<Eigen::Lower>() * own).eval();
  changed_.triangularView<Eigen::Lower>().solveInPlace(own);
  return partial;
}

Matrix ChangedTrailing::backward(ConstMatrixRef rhs) const {
  Matrix partial = rhs;
  auto own = partial.bottomRows(changed_.rows());
  changed_.triangularView<Eigen::Lower>().transpose().solveInPlace(own);
  own = (first_->trailing_factor().transpose().triangularView<Eigen::Upper>() * own).eval();
  return first_->backward(partial);
}

}  // namespace latin::algebra
