#pragma once

#include <functional>
#include <vector>

#include "substructure/laws.hpp"

namespace latin::substructure {

/// The interfaces as one nonlinear system f = R(j0) in their forces, one column after the other: what Newton's
/// method needs.
///
/// Its unknowns are the points and components of one interface after the other. For Newton's method every column is
/// a sample of its own: see suits(). On several ranks it is that of the interfaces of one.
class InterfaceSystem {
 public:
  /// Whether there is such a system, and whether it is of use: some law is nonlinear. Collective.
  [[nodiscard]] static bool suits(const Laws& laws);

  explicit InterfaceSystem(Laws laws);

  [[nodiscard]] const Laws& laws() const { return laws_; }
  [[nodiscard]] Index unknowns() const { return laws_.structure().interface_unknowns(); }
  /// 1/k1 + 1/k2 (unknowns)
  [[nodiscard]] const Vector& direct() const { return direct_; }

  /// First unknown of the point that each belongs to, and the number of its components.
  struct Layout {
    std::vector<Index> first;
    std::vector<Index> components;
  };
  [[nodiscard]] const Layout& layout() const { return layout_; }

  /// A flexibility (unknowns) with which the laws may be asked in place of 1/k1 + 1/k2: `wanted`, and no
  /// larger than that where a law may have several answers.
  [[nodiscard]] Vector law_flexibility(const Vector& wanted) const;
  /// j0 (unknowns, c) of an iterate, with direct(). Collective among neighbours.
  [[nodiscard]] Matrix free_jumps(ConstMatrixRef data, ConstMatrixRef traces) const;

  /// What the laws know of the columns before one, by interface.
  struct Memory {
    /// (numbers, points) what a law that is asked column by column keeps
    std::vector<Matrix> kept;
    /// (rows, columns of the history so far) for one that is only asked for whole histories
    std::vector<Matrix> jumps;
    std::vector<Matrix> forces;
  };
  /// Before the first column of a history.
  [[nodiscard]] Memory blank() const;
  /// Forces R(j0) (unknowns) of one column for free jumps that belong to the given flexibility (unknowns).
  [[nodiscard]] Vector forces(Index column, const Memory& before, ConstVectorRef jump,
                              ConstVectorRef flexibility) const;
  /// The same; the memory becomes that of this column.
  Vector advance(Index column, Memory& memory, ConstVectorRef jump,
                 ConstVectorRef flexibility) const;
  /// Derivatives of the forces of one column with respect to its own free jumps, by differences where the law
  /// does not know them: block-diagonal by point, (unknowns, most components); row = a component of the force,
  /// column = one of the jump at the same point.
  [[nodiscard]] Matrix slopes(Index column, const Memory& before, ConstVectorRef jump,
                              ConstVectorRef flexibility) const;
  /// The same of all columns of some histories, (unknowns, c) free jumps; laws without memory are asked for all
  /// columns at once.
  [[nodiscard]] std::vector<Matrix> slopes_of_all(ConstMatrixRef jumps,
                                                  ConstVectorRef flexibility) const;
  /// Columns that laws were asked for so far, those of several interfaces counted apart.
  [[nodiscard]] Index asked() const { return asked_; }

 private:
  [[nodiscard]] interface::LocalProblem problem(std::size_t interface, ConstMatrixRef jump,
                                                ConstVectorRef flexibility, Index steps) const;
  /// Components of the interface that has most.
  [[nodiscard]] Index most_components() const;
  void ask(std::size_t interface, Index column, const Memory& before, const Vector& jump,
           const Vector& flexibility, Matrix& kept, Vector& force) const;
  /// Forces (rows, c) for free jumps (rows, c) of an interface.
  using Asked = std::function<Matrix(const Matrix& jumps)>;

  /// An interface is before the first column of a history.
  void forget(std::size_t interface, Memory& memory) const;
  /// What a law keeps of its column of a history. @return its forces
  Vector advance_one(std::size_t interface, Index column, Memory& memory, const Vector& jump,
                     const Vector& flexibility) const;
  /// Slopes of one column of an interface.
  void slopes_of_one(std::size_t interface, Index column, const Memory& before, const Vector& jump,
                     const Vector& flexibility, MatrixRef slopes) const;
  /// Slopes of columns that do not depend on each other, (rows, components) each.
  [[nodiscard]] std::vector<Matrix> slopes_by_differences(std::size_t interface,
                                                          const Matrix& jumps,
                                                          const Vector& flexibility,
                                                          const Asked& forces) const;

  Laws laws_;
  Vector direct_;
  Layout layout_;
  mutable Index asked_ = 0;
};

}  // namespace latin::substructure
