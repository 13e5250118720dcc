#include "latin/substructure/pair.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Dense>

#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

/// A body that nothing else holds is held by this fraction of its springs. What floats is left to the coarse
/// problem, or to the acceleration.
constexpr double mu = 1e-3;
/// A perfect connection, relative to the flexibility 1/k1 + 1/k2: soft enough for the matrix, stiff
/// against every wave that a mesh can carry.
constexpr double softness = 1e-5;

}  // namespace

Pair::Pair(const std::array<PairSide, 2>& sides, const Vector& weights, const Vector& stiffness)
    : weights_(weights), of_law_(stiffness) {
  const Index rows = weights.size();
  std::array<Matrix, 2> held;
  Vector flexibility = Vector::Zero(rows);
  for (std::size_t s = 0; s < 2; ++s) {
    const Body& body = *sides[s].body;
    Side& side = sides_[s];
    side.row = sides[s].row;
    side.direction = body.directions().segment(sides[s].row_in_body, rows);
    flexibility += side.direction.cwiseInverse();
    // unknowns that the side touches, and its trace on them
    const SparseRows all = body.active_traces().middleRows(sides[s].row_in_body, rows);
    std::vector<Index> touched;
    std::vector<int> position(static_cast<std::size_t>(body.active()), -1);
    std::vector<Eigen::Triplet<double>> entries;
    for (Index row = 0; row < rows; ++row) {
      for (SparseRows::InnerIterator it(all, row); it; ++it) {
        int& at = position[static_cast<std::size_t>(it.col())];
        if (at < 0) {
          at = static_cast<int>(touched.size());
          touched.push_back(it.col());
        }
        entries.emplace_back(static_cast<int>(row), at, it.value());
      }
    }
    const auto count = static_cast<Index>(touched.size());
    side.trace.resize(rows, count);
    side.trace.setFromTriplets(entries.begin(), entries.end());

    if (count == 0) {  // a face that is held entirely
      held[s] = Matrix(0, 0);
      continue;
    }
    const Eigen::LLT<Matrix> compliance(body.inverse_block(touched));
    held[s] = (1.0 + mu) * compliance.solve(Matrix::Identity(count, count));
    const Vector springs = weights.cwiseProduct(side.direction);
    held[s] -= Matrix(SparseRows(side.trace.transpose() * (springs.asDiagonal() * side.trace)));
  }
  stiffness_ = (stiffness.cwiseInverse() + softness * flexibility).cwiseInverse();

  const Vector springs = weights.cwiseProduct(stiffness_);
  const std::array<Index, 3> first{0, held[0].rows(), held[0].rows() + held[1].rows()};
  Matrix matrix = Matrix::Zero(first[2], first[2]);
  for (std::size_t s = 0; s < 2; ++s) {
    for (std::size_t t = 0; t <= s; ++t) {
      const SparseRows product =
          sides_[s].trace.transpose() * (springs.asDiagonal() * sides_[t].trace);
      auto block = matrix.block(first[s], first[t], held[s].rows(), held[t].rows());
      block = (s == t ? 1.0 : -1.0) * Matrix(product);
      if (s == t) {
        block += held[s];
      }
    }
  }
  const Eigen::LLT<Matrix> cholesky(matrix);
  if (cholesky.info() != Eigen::Success) {
    throw NumericalError("bodies '" + sides[0].body->name() + "' and '" + sides[1].body->name() +
                         "': the operator of their interface is not definite");
  }
  lower_ = cholesky.matrixL();
}

void Pair::apply(MatrixRef residual) const {
  const Index rows = weights_.size();
  const Index split = sides_[0].trace.cols();
  const Matrix half1 = 0.5 * residual.middleRows(sides_[0].row, rows);
  const Matrix half2 = 0.5 * residual.middleRows(sides_[1].row, rows);
  Matrix force =
      stiffness_.asDiagonal() * (sides_[0].direction.cwiseInverse().asDiagonal() * half1 -
                                 sides_[1].direction.cwiseInverse().asDiagonal() * half2);
  Matrix q(lower_.rows(), residual.cols());
  q.topRows(split) = sides_[0].trace.transpose() * (weights_.asDiagonal() * (half1 + force));
  q.bottomRows(lower_.rows() - split) =
      sides_[1].trace.transpose() * (weights_.asDiagonal() * (half2 - force));
  lower_.triangularView<Eigen::Lower>().solveInPlace(q);
  lower_.triangularView<Eigen::Lower>().transpose().solveInPlace(q);
  const Matrix w1 = sides_[0].trace * q.topRows(split);
  const Matrix w2 = sides_[1].trace * q.bottomRows(lower_.rows() - split);
  force += stiffness_.asDiagonal() * (w2 - w1);
  residual.middleRows(sides_[0].row, rows) = half1 + force + sides_[0].direction.asDiagonal() * w1;
  residual.middleRows(sides_[1].row, rows) = half2 - force + sides_[1].direction.asDiagonal() * w2;
}

}  // namespace latin::substructure
