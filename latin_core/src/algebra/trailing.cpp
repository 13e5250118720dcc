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

Matrix ChangedTrailing::solve(ConstMatrixRef rhs) const {
  const Index size = trailing_.rows();
  const auto old = trailing_.triangularView<Eigen::Lower>();
  Matrix first = first_->solve(rhs);
  const Matrix before = first.bottomRows(size);
  const Matrix left = old * (old.transpose() * before).eval();
  Matrix now = left;
  changed_.triangularView<Eigen::Lower>().solveInPlace(now);
  changed_.triangularView<Eigen::Lower>().transpose().solveInPlace(now);
  Matrix forces = Matrix::Zero(first.rows(), first.cols());
  forces.bottomRows(size) = old * (old.transpose() * (now - before)).eval();
  return first + first_->solve(forces);
}

}  // namespace latin::algebra
