#pragma once

#include <Eigen/LU>
#include <vector>

#include "latin/common/types.hpp"
#include "latin/substructure/tangent.hpp"

namespace latin::substructure {

/// The linearised structure where most of it stays as it is: only the tangents of nonlinear laws change from one step
/// of Newton's method to the next.
///
/// With A = S + J^T W K0 J, which has the tangents of the linear laws and springs of the search direction for the
/// others, and V the jumps of those others,
///
///     (A + V^T W D V)^-1 b = A^-1 (b - V^T W D (1 + G W D)^-1 V A^-1 b),     G = V A^-1 V^T,
///
/// D their tangents less the springs: A and G are made once, and a step costs a dense factorisation of the size of V.
/// It is a difference, and less exact than a factorisation of the whole where parts are hardly held.
class ContactTangent {
 public:
  /// Springs that have to hold open points, relative to the search direction.
  static constexpr double least_hold = 1e-10;

  /// @param tangent it must outlive this object, which alone uses its factor
  /// @param varying unknowns whose tangents change, in ascending order, all of a point or none
  ContactTangent(Tangent& tangent, std::vector<Index> varying);
  /// Whether what varies is little enough.
  [[nodiscard]] static bool pays(const Tangent& tangent, const std::vector<Index>& varying);

  [[nodiscard]] const std::vector<Index>& varying() const { return varying_; }
  /// Operations of one factorisation.
  [[nodiscard]] double work() const;
  /// @param stiffness of the interfaces (force / length^3), (unknowns, most components)
  /// @param springs beside it in the jumps of what varies, (unknowns)
  /// @throws NumericalError if the structure is not stable with them
  void factorise(const Matrix& stiffness, const Vector& springs);
  /// Displacements of the active unknowns under forces on them, (active) both.
  [[nodiscard]] Vector solve(const Vector& load);

 private:
  void take_others(const Matrix& stiffness);

  Tangent& tangent_;
  std::vector<Index> varying_;
  SparseRows jumps_;    ///< V
  Vector reference_;    ///< K0 of what varies, (varying)
  Matrix others_;       ///< the tangents in A; empty: there is none
  Matrix answers_;      ///< A^-1 V^T
  Matrix flexibility_;  ///< G
  Matrix change_;       ///< D by point, (varying, components)
  Eigen::PartialPivLU<Matrix> factor_;
};

}  // namespace latin::substructure
