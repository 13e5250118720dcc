#include "latin/latin/flexibility.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Dense>

#include "latin/common/error.hpp"

namespace latin {

Flexibility::Flexibility(const std::vector<Body>& bodies, const std::vector<Index>& first_rows,
                         std::vector<Index> unknown, Vector sign, Index unknowns)
    : unknown_(std::move(unknown)),
      sign_(std::move(sign)),
      inverse_direction_(sign_.size()),
      direct_(Vector::Zero(unknowns)),
      matrix_(Matrix::Zero(unknowns, unknowns)) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const Body& body = bodies[b];
    const Index rows = body.rows();
    if (rows == 0) {
      continue;
    }
    inverse_direction_.segment(first_rows[b], rows) = body.directions().cwiseInverse();
    const SparseRows& trace = body.active_traces();
    const Vector robin = body.weights().cwiseProduct(body.directions());
    // L L^T = S + T^T W k T is given; held by mu k alone: (1 + mu) L L^T - T^T W k T
    const Matrix lower = body.condensed_factor().triangularView<Eigen::Lower>();
    Matrix stiffness = lower.triangularView<Eigen::Lower>() * lower.transpose();
    stiffness *= 1.0 + mu;
    const SparseRows springs = trace.transpose() * SparseRows(robin.asDiagonal() * trace);
    stiffness -= Matrix(springs);
    const Eigen::LLT<Matrix> cholesky(stiffness);
    if (cholesky.info() != Eigen::Success) {
      throw NumericalError("body '" + body.name() + "': its flexibility cannot be factorised");
    }
    parts_.push_back({&body, first_rows[b], cholesky.matrixL()});
    // Y = L^-1 T^T E, so that the flexibility is Y^T Y W
    std::vector<Eigen::Triplet<double>> entries;
    std::vector<Index> here(static_cast<std::size_t>(unknowns), -1);
    std::vector<Index> touched;
    for (Index row = 0; row < rows; ++row) {
      const auto of = static_cast<std::size_t>(unknown_[static_cast<std::size_t>(first_rows[b] + row)]);
      if (here[of] < 0) {
        here[of] = static_cast<Index>(touched.size());
        touched.push_back(static_cast<Index>(of));
      }
    }
    Matrix y = Matrix::Zero(body.active(), static_cast<Index>(touched.size()));
    Vector area(y.cols());
    for (Index row = 0; row < rows; ++row) {
      const auto at = static_cast<std::size_t>(first_rows[b] + row);
      const Index column = here[static_cast<std::size_t>(unknown_[at])];
      area(column) = body.weights()(row);
      for (SparseRows::InnerIterator it(trace, row); it; ++it) {
        y(it.col(), column) += sign_(static_cast<Index>(at)) * it.value();
      }
    }
    parts_.back().factor.triangularView<Eigen::Lower>().solveInPlace(y);
    Matrix product = Matrix::Zero(y.cols(), y.cols());
    product.selfadjointView<Eigen::Lower>().rankUpdate(y.transpose());
    product.triangularView<Eigen::StrictlyUpper>() = product.transpose();
    matrix_(touched, touched) += product * area.asDiagonal();
  }
  for (Index row = 0; row < inverse_direction_.size(); ++row) {
    direct_(unknown_[static_cast<std::size_t>(row)]) += inverse_direction_(row);
  }
  matrix_.diagonal() += direct_;
  matrix_ /= 1.0 + mu;
}

Matrix Flexibility::solve(ConstMatrixRef v) const {
  // (1 + mu - k A)^-1 = (1 + k T (S + mu (S + T^T W k T))^-1 T^T W) / (1 + mu)
  Matrix result = v;
  for (const Part& part : parts_) {
    const SparseRows& trace = part.body->active_traces();
    auto of_body = result.middleRows(part.first_row, part.body->rows());
    Matrix unknowns = trace.transpose() * (part.body->weights().asDiagonal() * of_body);
    part.factor.triangularView<Eigen::Lower>().solveInPlace(unknowns);
    part.factor.triangularView<Eigen::Lower>().transpose().solveInPlace(unknowns);
    of_body += part.body->directions().asDiagonal() * (trace * unknowns);
  }
  return result / (1.0 + mu);
}

Matrix Flexibility::spread(ConstMatrixRef y) const {
  Matrix result(sign_.size(), y.cols());
  for (Index row = 0; row < result.rows(); ++row) {
    result.row(row) = sign_(row) * y.row(unknown_[static_cast<std::size_t>(row)]);
  }
  return result;
}

Matrix Flexibility::jump(ConstMatrixRef v) const {
  Matrix result = Matrix::Zero(unknowns(), v.cols());
  for (Index row = 0; row < v.rows(); ++row) {
    result.row(unknown_[static_cast<std::size_t>(row)]) +=
        sign_(row) * inverse_direction_(row) * v.row(row);
  }
  return result;
}

}  // namespace latin
