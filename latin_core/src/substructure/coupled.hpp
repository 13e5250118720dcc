#pragma once

#include <vector>

#include "latin/common/types.hpp"
#include "substructure/laws.hpp"
#include "substructure/local_stage.hpp"
#include "substructure/size.hpp"
#include "substructure/tangent.hpp"

namespace latin::substructure {

/// The columns of a chaos with linear laws as one system of equations,
///
///     (S A + D + J^T W K J) du = T^T W r / 2 + J^T W K q + l,     see Tangent,
///
/// in which random stiffnesses couple the columns: K of interfaces, the factors A of the stiffness of whole bodies, D
/// of the fields inside others. The latter are in it with all their unknowns, and with what their last solution left
/// of their own equations, l; the others condensed. Conjugate gradients, with the structure of the means as
/// preconditioner: it is never applied, for it is known on every search direction. Of one rank.
class Coupled {
 public:
  /// @param tangent of the means, symmetric; it and the local stage must outlive this object
  Coupled(Tangent& tangent, LocalStage& local);

  /// Whether there is such a system: see correct().
  [[nodiscard]] static bool possible(const Laws& laws);

  /// From an iterate to the answer. Rigid laws are taken with the tangents that they have in the preconditioner: what a
  /// step misses of them shows in the residual after it.
  /// @param tolerance on the energy norm of the errors of every group, relative to the group
  /// @param round     how often that was done before: what rigid laws leave is no smaller than so many rounds make it
  /// @param energies  of the groups so far, which grow by those of the step; empty: none
  /// @param residual  (rows, c) into the step on the data, in place
  /// @param moved     what the step does to the traces, (rows, c)
  /// @return the factor by which errors in energy may be larger than what Tangent::correct() says of them, squared; 0
  /// where there is no answer, and nothing has changed then
  double correct(double tolerance, int round, Vector& energies, MatrixRef residual,
                 MatrixRef moved);

 private:
  /// A body with a field, in all its unknowns.
  struct Inside {
    std::size_t body;
    const FieldBody* field;
    Index first;  ///< of its active unknowns
  };
  struct Unknowns {
    Matrix active;               ///< of all bodies, (active, c)
    std::vector<Matrix> inside;  ///< (n_body, c), the active ones last: those are above, too
  };
  [[nodiscard]] const Body& body(const Inside& inside) const {
    return structure_.bodies()[inside.body];
  }
  [[nodiscard]] auto rows_of(const Inside& inside) const {
    return Eigen::seqN(inside.first, body(inside).active());
  }
  [[nodiscard]] Unknowns zero(Index columns) const;
  void springs(const Matrix& jumps, Matrix& forces);
  void ask_at_rest(Index columns);
  [[nodiscard]] Unknowns precondition(const Unknowns& forces);
  void add_change(const Unknowns& moved, Unknowns& forces);
  void add_scaled(const Unknowns& moved, Unknowns& forces) const;
  [[nodiscard]] Vector products(const Unknowns& a, const Unknowns& b) const;

  Tangent& tangent_;
  LocalStage& local_;
  const Structure& structure_;
  ColumnGroups groups_;
  std::vector<Inside> inside_;
  Matrix at_rest_;            ///< forces of the laws without jumps, (unknowns, c); empty: none
  std::vector<Index> rigid_;  ///< unknowns whose laws are rigid
  std::vector<bool> asked_;   ///< interfaces with others
  SparseRows nodal_;          ///< J^T W
  Matrix jumps_;
  Matrix between_;
  Matrix of_means_;  ///< forces per area of the means
};

}  // namespace latin::substructure
