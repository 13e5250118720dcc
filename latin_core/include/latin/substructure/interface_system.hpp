#pragma once

#include <vector>

#include "latin/substructure/laws.hpp"

namespace latin::substructure {

/// The interfaces as one nonlinear system f = R(j0) in their forces, (unknowns, c): what Newton's method needs.
///
/// Its unknowns are the points and components of one interface after the other. Every column is a sample of its
/// own, all sides are on this rank, and all bodies are condensed: see suits().
class InterfaceSystem {
 public:
  /// Whether there is such a system, of use (some law is nonlinear) and affordable (at most `limit` unknowns).
  [[nodiscard]] static bool suits(const Laws& laws, Index limit);

  /// @throws NumericalError if a body has no usable flexibility
  explicit InterfaceSystem(Laws laws);

  [[nodiscard]] const Laws& laws() const { return laws_; }
  [[nodiscard]] Index unknowns() const { return laws_.structure().interface_unknowns(); }
  /// Dense flexibility of the bodies.
  [[nodiscard]] const Flexibility& flexibility() const { return flexibility_; }

  /// First unknown of the point that each belongs to, and the number of its components.
  struct Layout {
    std::vector<Index> first;
    std::vector<Index> components;
  };
  [[nodiscard]] const Layout& layout() const { return layout_; }

  /// A flexibility (unknowns) with which the laws may be asked in place of 1/k1 + 1/k2: `wanted`, and no
  /// larger than that where a law may have several answers.
  [[nodiscard]] Vector law_flexibility(const Vector& wanted) const;
  /// j0 (unknowns, c) of an iterate.
  [[nodiscard]] Matrix free_jumps(ConstMatrixRef data, ConstMatrixRef traces) const;
  /// Forces R(j0) (unknowns, c) for free jumps that belong to the given flexibility (unknowns).
  [[nodiscard]] Matrix forces(ConstMatrixRef jumps, ConstVectorRef flexibility) const;
  /// Derivatives of the forces of one column with respect to its own free jumps, by differences where the law
  /// does not know them: block-diagonal by point, (unknowns, most components); row = a component of the force,
  /// column = one of the jump at the same point.
  [[nodiscard]] Matrix slopes(ConstMatrixRef jumps, ConstVectorRef flexibility, Index column) const;

 private:
  void ask(std::size_t interface, ConstMatrixRef jump, ConstVectorRef flexibility,
           Matrix& force) const;
  void slopes_by_differences(std::size_t interface, const Matrix& jump, const Vector& flexibility,
                             Index column, MatrixRef slopes) const;

  Laws laws_;
  const Flexibility& flexibility_;
  Layout layout_;
};

}  // namespace latin::substructure
