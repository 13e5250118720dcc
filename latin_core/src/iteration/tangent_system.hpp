#pragma once

#include <vector>

#include "algebra/dense_lu.hpp"
#include "latin/common/types.hpp"
#include "substructure/flexibility.hpp"
#include "substructure/interface_system.hpp"

namespace latin::iteration {

/// The linear systems of Newton's steps on the dense flexibility of the interfaces.
///
/// With the tangent T of the laws, the change of the free jumps m(z, a) that changes z of the forces and a of the
/// amplitudes of the modes bring, theta and J the stiffness and the jumps of the modes, W the areas:
///
///     z - T m(z, a) = right of the forces,      theta a - J^T W z = right of the modes.
///
/// Only rows with a tangent other than zero (the closed zone) are coupled. One LU of that zone is kept, of a tangent that
/// is softened a little: forces that the meshes do not determine get no change but for rounding. It is the preconditioner
/// of GMRES with the tangent itself, and with later ones: a row that changed costs one product at most. Where that does
/// not pay the LU is made anew.
class TangentSystem {
 public:
  /// @param shift (unknowns) of the free jumps with the forces at the same point: the flexibility at which the laws
  ///              are asked, and that of the search directions
  TangentSystem(const substructure::Flexibility& flexibility,
                const substructure::InterfaceSystem::Layout& layout, Vector shift);
  TangentSystem(const TangentSystem&) = delete;
  TangentSystem(TangentSystem&&) = delete;
  TangentSystem& operator=(const TangentSystem&) = delete;
  TangentSystem& operator=(TangentSystem&&) = delete;
  ~TangentSystem() = default;

  /// Change of the free jumps with changes of the forces (unknowns) and of the amplitudes (modes).
  [[nodiscard]] Vector moved(ConstVectorRef y, ConstVectorRef a) const;
  /// T p, by point.
  [[nodiscard]] Vector times(const Matrix& tangent, ConstVectorRef p) const;
  /// Solve with a tangent as of `InterfaceSystem::slopes`.
  /// @param right of the forces, then of the modes
  /// @return z and a; not finite where there is no answer
  [[nodiscard]] Vector solve(const Matrix& tangent, const Vector& right);

  [[nodiscard]] Index modes() const { return modal_stiffness_.size(); }
  /// theta, with the springs that hold the modes.
  [[nodiscard]] const Vector& modal_stiffness() const { return modal_stiffness_; }
  /// Hold the modes by springs, relative to the search direction.
  void hold(double spring);
  /// LU factorisations so far, and products with the flexibility in their place.
  [[nodiscard]] Index factorisations() const { return factorisations_; }
  [[nodiscard]] Index products() const { return products_; }

 private:
  void factorise(const Matrix& tangent);
  [[nodiscard]] bool fits(const Matrix& tangent) const;
  /// GMRES with the LU as it is. @return whether that was possible
  [[nodiscard]] bool approach(const Matrix& tangent, const Vector& right, Index most,
                              Vector& answer);
  [[nodiscard]] Vector apply(const Matrix& tangent, const Vector& x) const;
  [[nodiscard]] Vector solve_factorised(const Vector& right) const;

  const substructure::Flexibility& flexibility_;
  const substructure::InterfaceSystem::Layout& layout_;
  Vector shift_;
  Vector modal_stiffness_;
  Vector energies_;          ///< roots of those of unit forces at the points, and 1 for the modes
  std::vector<Index> rows_;  ///< of the closed zone
  Matrix tangent_;
  algebra::DenseLU lu_;  ///< of the transposed system
  Index factorisations_ = 0;
  Index products_ = 0;
};

}  // namespace latin::iteration
