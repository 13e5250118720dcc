#include "substructure/pair.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <utility>

#include "algebra/inverse.hpp"
#include "algebra/sparse_product.hpp"
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

PairSide::PairSide(const Body& of, Index row_in_body, const Vector& weights)
    : direction(of.directions().segment(row_in_body, weights.size())), body(of.name()) {
  SideTrace side = of.trace_of_side(row_in_body, weights.size());
  trace.swap(side.trace);
  const auto count = static_cast<Index>(side.touched.size());
  if (count == 0) {  // a face that is held entirely
    held = Matrix(0, 0);
    return;
  }
  const Eigen::LLT<Matrix> compliance(of.inverse_block(side.touched));
  if (compliance.info() != Eigen::Success) {
    throw NumericalError("body '" + body + "': its flexibility at a face is not definite");
  }
  held = (1.0 + mu) * algebra::inverse_of_factored(compliance.matrixLLT());
  const Vector springs = weights.cwiseProduct(direction);
  held -= Matrix(SparseRows(trace.transpose() * (springs.asDiagonal() * trace)));
}

std::vector<double> PairSide::packed() const {
  std::vector<double> numbers;
  algebra::append(trace, numbers);
  numbers.insert(numbers.end(), direction.begin(), direction.end());
  numbers.insert(numbers.end(), held.data(), held.data() + held.size());
  return numbers;
}

PairSide PairSide::unpacked(const std::vector<double>& numbers, std::string name) {
  PairSide side;
  side.body = std::move(name);
  const double* next = numbers.data();
  algebra::take(next).swap(side.trace);
  side.direction = Eigen::Map<const Vector>(next, side.trace.rows());
  next += side.trace.rows();
  side.held = Eigen::Map<const Matrix>(next, side.trace.cols(), side.trace.cols());
  return side;
}

Pair::Pair(std::array<PairSide, 2> sides, const Vector& weights, const Vector& stiffness)
    : sides_(std::move(sides)), weights_(weights), of_law_(stiffness) {
  const Vector flexibility =
      sides_[0].direction.cwiseInverse() + sides_[1].direction.cwiseInverse();
  stiffness_ = (stiffness.cwiseInverse() + softness * flexibility).cwiseInverse();

  const Vector springs = weights.cwiseProduct(stiffness_);
  const std::array<Index, 3> first{0, sides_[0].held.rows(),
                                   sides_[0].held.rows() + sides_[1].held.rows()};
  Matrix matrix = Matrix::Zero(first[2], first[2]);
  for (std::size_t s = 0; s < 2; ++s) {
    for (std::size_t t = 0; t <= s; ++t) {
      const SparseRows product =
          sides_[s].trace.transpose() * (springs.asDiagonal() * sides_[t].trace);
      auto block = matrix.block(first[s], first[t], sides_[s].held.rows(), sides_[t].held.rows());
      block = (s == t ? 1.0 : -1.0) * Matrix(product);
      if (s == t) {
        block += sides_[s].held;
      }
    }
  }
  const Eigen::LLT<Matrix> cholesky(matrix);
  if (cholesky.info() != Eigen::Success) {
    throw NumericalError("bodies '" + sides_[0].body + "' and '" + sides_[1].body +
                         "': the operator of their interface is not definite");
  }
  lower_ = cholesky.matrixL();
  for (PairSide& side : sides_) {
    side.held.resize(0, 0);
  }
}

void Pair::apply(MatrixRef first, MatrixRef second) const {
  const Index split = sides_[0].trace.cols();
  const Matrix half1 = 0.5 * first;
  const Matrix half2 = 0.5 * second;
  Matrix force =
      stiffness_.asDiagonal() * (sides_[0].direction.cwiseInverse().asDiagonal() * half1 -
                                 sides_[1].direction.cwiseInverse().asDiagonal() * half2);
  Matrix q(lower_.rows(), first.cols());
  q.topRows(split) = sides_[0].trace.transpose() * (weights_.asDiagonal() * (half1 + force));
  q.bottomRows(lower_.rows() - split) =
      sides_[1].trace.transpose() * (weights_.asDiagonal() * (half2 - force));
  lower_.triangularView<Eigen::Lower>().solveInPlace(q);
  lower_.triangularView<Eigen::Lower>().transpose().solveInPlace(q);
  const Matrix w1 = sides_[0].trace * q.topRows(split);
  const Matrix w2 = sides_[1].trace * q.bottomRows(lower_.rows() - split);
  force += stiffness_.asDiagonal() * (w2 - w1);
  first = half1 + force + sides_[0].direction.asDiagonal() * w1;
  second = half2 - force + sides_[1].direction.asDiagonal() * w2;
}

}  // namespace latin::substructure
