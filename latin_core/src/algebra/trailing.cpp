#include "latin/algebra/trailing.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <utility>

#include "latin/common/error.hpp"

namespace latin::algebra {

ChangedTrailing::ChangedTrailing(std::shared_ptr<const Factor> first, Matrix trailing,
                                 const SparseRows& change, const std::string& name)
    : first_(std::move(first)), trailing_(std::move(trailing)) {
  const Index size = trailing_.rows();
  Matrix sum = Matrix::Zero(size, size);
  const Matrix lower = trailing_.triangularView<Eigen::Lower>();
  sum.selfadjointView<Eigen::Lower>().rankUpdate(lower);
  for (Index row = 0; row < change.outerSize(); ++row) {
    for (SparseRows::InnerIterator it(change, row); it; ++it) {
      if (it.col() <= row) {
        sum(row, it.col()) += it.value();
      }
    }
  }
  const Eigen::LLT<Eigen::Ref<Matrix>> factor(sum);
  if (factor.info() != Eigen::Success) {
    throw NumericalError("the stiffness of '" + name +
                         "' is not positive definite with its changed interfaces");
  }
  changed_ = sum.triangularView<Eigen::Lower>();
}

Matrix ChangedTrailing::forward(ConstMatrixRef rhs) const {
  Matrix partial = first_->forward(rhs);
  auto own = partial.bottomRows(trailing_.rows());
  own = (trailing_.triangularView<Eigen::Lower>() * own).eval();
  changed_.triangularView<Eigen::Lower>().solveInPlace(own);
  return partial;
}

Matrix ChangedTrailing::backward(ConstMatrixRef rhs) const {
  Matrix partial = rhs;
  auto own = partial.bottomRows(trailing_.rows());
  changed_.triangularView<Eigen::Lower>().transpose().solveInPlace(own);
  own = (trailing_.triangularView<Eigen::Lower>().transpose() * own).eval();
  return first_->backward(partial);
}

}  // namespace latin::algebra
