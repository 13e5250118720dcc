#pragma once

#include <vector>

#include "stochastic/basis.hpp"

namespace latin::stochastic {

/// Blocks of modes (rows, c) whose modes are neighbours in memory.
using ModeRows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using ConstModeRowsRef = Eigen::Ref<const ModeRows>;
using ModeRowsRef = Eigen::Ref<ModeRows>;

/// The product with a random scalar a, projected on the modes: v_k = sum_j A_kj u_j with the Galerkin matrix
/// A = sum_i a_i E[Psi_i Psi_j Psi_k] of every point (see galerkin_matrix()).
///
/// The matrices of all points share one pattern, and what vanishes by degree or symmetry is not stored: a field in
/// five germs at order 5 takes some 3 000 numbers a point, its 252 x 252 matrix 63 504.
class Coupling {
 public:
  /// @param basis        germs and modes j, k
  /// @param coefficients (1, property.size()) of a parameter, (points, ...) of a field; unit of a
  /// @param property     multi-indices of a, in the same germs
  /// @throws InputError as galerkin_matrix()
  Coupling(const ChaosBasis& basis, ConstMatrixRef coefficients, const MultiIndexSet& property);

  [[nodiscard]] Index modes() const { return static_cast<Index>(starts_.size()) - 1; }
  /// 1 if a is the same at all points.
  [[nodiscard]] Index points() const { return values_.cols(); }
  /// Entries A(first, second) in the order of `second`, and their values (entries, points).
  [[nodiscard]] const std::vector<Index>& first() const { return first_; }
  [[nodiscard]] std::vector<Index> second() const;
  [[nodiscard]] const Matrix& values() const { return values_; }

  /// A (c, c) at one point. @throws InputError if there is none
  [[nodiscard]] Matrix matrix(Index point) const;
  /// Fields u (points * components, c), the components of a point one after the other, times a.
  /// @param v (points * components, c), overwritten
  /// @throws InputError on a shape that does not fit
  void apply(ConstModeRowsRef u, Index components, ModeRowsRef v) const;

  /// Lower bounds (points) of the eigenvalues, by Gershgorin.
  [[nodiscard]] Vector bounds() const;
  /// The smallest eigenvalue over all points.
  [[nodiscard]] double smallest() const;

 private:
  std::vector<Index> starts_;  ///< of the entries of every column
  std::vector<Index> first_;
  Matrix values_;
};

}  // namespace latin::stochastic
