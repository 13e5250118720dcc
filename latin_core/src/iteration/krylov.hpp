#pragma once

#include <Eigen/Jacobi>
#include <cmath>
#include <vector>

#include "latin/common/types.hpp"

namespace latin::iteration {

/// What gmres() came to.
struct KrylovOutcome {
  Index products = 0;  ///< with the matrix
  bool solved = false;
};

/// Solve A x = b by GMRES with a right preconditioner, without restart: it keeps `most` vectors.
///
/// It ends early where the rate so far does not lead to the tolerance within `most` products.
/// @param apply, precondition Vector -> Vector
/// @param x         answer, from zero
/// @param tolerance on the residual, relative to b
template <class Apply, class Precondition>
KrylovOutcome gmres(const Apply& apply, const Precondition& precondition, const Vector& b,
                    Vector& x, double tolerance, Index most) {
  /// Products after which the rate says something.
  constexpr Index told = 6;
  KrylovOutcome outcome;
  x = Vector::Zero(b.size());
  const double size = b.norm();
  if (!(size > 0.0)) {
    outcome.solved = size == 0.0;
    return outcome;
  }
  std::vector<Vector> basis{b / size};
  std::vector<Vector> preconditioned;
  Matrix triangle = Matrix::Zero(most, most);
  Vector right = Vector::Zero(most + 1);
  right(0) = size;
  std::vector<Eigen::JacobiRotation<double>> turns;
  while (outcome.products < most) {
    const Index k = outcome.products++;
    preconditioned.push_back(precondition(basis.back()));
    Vector next = apply(preconditioned.back());
    Vector column = Vector::Zero(k + 2);
    for (int twice = 0; twice < 2; ++twice) {
      for (Index i = 0; i <= k; ++i) {
        const double along = basis[static_cast<std::size_t>(i)].dot(next);
        next -= along * basis[static_cast<std::size_t>(i)];
        column(i) += along;
      }
    }
    column(k + 1) = next.norm();
    if (!column.allFinite()) {
      return outcome;
    }
    for (Index i = 0; i < k; ++i) {
      column.applyOnTheLeft(i, i + 1, turns[static_cast<std::size_t>(i)].adjoint());
    }
    turns.emplace_back();
    const double beyond = column(k + 1);
    turns.back().makeGivens(column(k), beyond);
    column.applyOnTheLeft(k, k + 1, turns.back().adjoint());
    right.applyOnTheLeft(k, k + 1, turns.back().adjoint());
    triangle.col(k).head(k + 1) = column.head(k + 1);
    const double left = std::abs(right(k + 1)) / size;
    outcome.solved = left <= tolerance;
    const auto done = static_cast<double>(k + 1);
    const bool hopeless =
        k + 1 >= told && std::log(left) * static_cast<double>(most) / done > std::log(tolerance);
    if (outcome.solved || hopeless || beyond == 0.0) {
      break;
    }
    basis.emplace_back(next / beyond);
  }
  const Index k = outcome.products;
  const Vector shares =
      triangle.topLeftCorner(k, k).triangularView<Eigen::Upper>().solve(right.head(k));
  for (Index i = 0; i < k; ++i) {
    x += shares(i) * preconditioned[static_cast<std::size_t>(i)];
  }
  outcome.solved = outcome.solved && x.allFinite();
  return outcome;
}

}  // namespace latin::iteration
