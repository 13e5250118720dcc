#pragma once

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <functional>
#include <memory>
#include <vector>

#include "algebra/factor.hpp"
#include "algebra/general_factor.hpp"
#include "algebra/sparse_product.hpp"
#include "latin/common/types.hpp"
#include "substructure/joined.hpp"
#include "substructure/size.hpp"

namespace latin::substructure {

/// The assembled structure, linearised: condensed bodies joined by the tangent stiffnesses of their interfaces.
///
/// With S the stiffness of the bodies on their active unknowns, J the jump of these at the interface points, W the
/// areas and K the tangents of the laws (force / length^3), a residual r = 2 (f^ - f) of the two stages asks for
///
///     (S + J^T W K J) du = T^T W r / 2 + J^T W K q,     q = J' r / (2 k),
///
/// J' the difference of the sides: a step of Newton's method on the whole structure. It sees what the two
/// stages hardly see, soft and rigid motions of single bodies. Where a law is rigid, or a body hangs on
/// nothing, K and S are replaced by something very stiff or very soft: what a step misses shows in the residual
/// after it. Friction makes it unsymmetric, softening indefinite.
///
/// It is that of all ranks, on each of them, and tables of rows are those of this rank: what takes them is collective.
class Tangent {
 public:
  /// Springs that hold what hangs on nothing, relative to the search direction.
  static constexpr double least_hold = 1e-11;

  /// Whether it can be made at a price that fits that of the bodies; the same on all ranks.
  [[nodiscard]] static bool possible(const Structure& structure);
  /// The same at a price that a run without an answer may pay.
  [[nodiscard]] static bool bearable(const Structure& structure);

  explicit Tangent(const Structure& structure);
  /// Of a structure that is joined already.
  Tangent(const Structure& structure, std::shared_ptr<const Joined> joined);

  /// What it is the tangent of.
  [[nodiscard]] const Joined& joined() const { return *joined_; }
  [[nodiscard]] const std::shared_ptr<const Joined>& shared_joined() const { return joined_; }
  /// The component of its point that an unknown is.
  [[nodiscard]] Index component(Index unknown) const {
    return component_[static_cast<std::size_t>(unknown)];
  }
  /// Flexibility (unknowns) at which the laws are asked.
  [[nodiscard]] const Vector& flexibility() const { return flexibility_; }
  /// Take other tangents, unless they are the same.
  /// @param slopes of the laws, (unknowns, most components), see InterfaceSystem::slopes()
  /// @throws NumericalError if the structure is not stable with them
  /// @param hold springs on all bodies, relative to the search direction
  void factorise(const Matrix& slopes, double hold);
  /// Residual (rows, c) into the step on the data, in place.
  /// @param moved what the step does to the traces, (rows, c)
  void correct(MatrixRef residual, MatrixRef moved);
  /// The same for half of the residual of all ranks, (rows of all, c). Not collective.
  /// @param step, moved of this rank, (rows, c)
  void correct_all(const Matrix& half, MatrixRef step, MatrixRef moved);
  /// Corrections with tangents of every column's own, which must be symmetric and stable: by conjugate gradients on
  /// the active unknowns, with this factorisation as preconditioner. Of one rank.
  /// @param slopes   of the laws in every column, as factorise() takes them
  /// @param basis    orthonormal columns (active, m), in which the best answers in energy are looked for first
  /// @param fall     what the error in energy is to fall to, relative to that of no correction, (c)
  /// @param residual (rows, c) into the step on the data, in place
  /// @param moved    what the step does to the traces, (rows, c)
  /// @return the displacements of the active unknowns, (active, c); empty where there are no such tangents, and
  /// nothing has changed then
  Matrix correct_each(const std::vector<Matrix>& slopes, const Matrix& basis, const Vector& fall,
                      MatrixRef residual, MatrixRef moved);
  /// What forces on the active unknowns of the bodies (active, c) do to the data and the traces, (rows, c).
  /// @return the displacements of these unknowns, (active, c)
  Matrix respond(const Matrix& forces, MatrixRef data, MatrixRef moved);
  /// The forces in the bodies, of which those at their faces are the balance, where they move like that (rows, c):
  /// what rounding is relative to, (active, c).
  [[nodiscard]] Matrix inner_forces(const Matrix& traces) const;
  /// Forces per area (rows, c) as those on the active unknowns of the bodies, (active, c): what the meshes see of them.
  [[nodiscard]] Matrix nodal(const Matrix& forces) const {
    Matrix nodal(active_, forces.cols());
    algebra::multiply_sparse(to_unknowns_,
                             joined_->weights().asDiagonal() * joined_->of_rows(forces), nodal);
    return nodal;
  }
  /// u^T S u of a body of this rank, where all active unknowns move by (active).
  [[nodiscard]] double strain(Index body, ConstVectorRef moved) const;
  /// Displacements of the active unknowns of the bodies under forces on them, (active, c) both.
  [[nodiscard]] Matrix solve(const Matrix& load);
  /// T: active unknowns into rows; J': rows into jumps; J: active unknowns into jumps.
  [[nodiscard]] const SparseRows& traces() const { return traces_; }
  [[nodiscard]] const SparseRows& sides() const { return sides_; }
  [[nodiscard]] const SparseRows& jumps() const { return jumps_; }
  /// W K of the last factorisation, (unknowns, unknowns), and the springs that hold the bodies, (rows).
  [[nodiscard]] const SparseRows& springs() const { return tangent_; }
  [[nodiscard]] const Vector& holding() const { return holding_; }
  [[nodiscard]] bool symmetric() const { return symmetric_; }
  /// Areas (unknowns).
  [[nodiscard]] const Vector& areas() const { return areas_; }
  /// Many blocks of so many columns will be solved for.
  void expect(Index columns);
  /// The diagonal of S, (active).
  [[nodiscard]] Vector diagonal() const;
  /// Whether a rigid connection was made a spring: steps of linear laws are exact but for that.
  [[nodiscard]] bool softened() const { return softened_; }
  /// First active unknown of every body, and one past the last.
  [[nodiscard]] const std::vector<Index>& first_active() const { return joined_->first_active(); }

 private:
  void set_rigid();
  /// @param of_point tangent (components, components) of the point whose first unknown is given
  void set_tangents(const std::function<Matrix(const Joined::JoinedInterface&, Index)>& of_point);
  [[nodiscard]] Matrix tangent_at(const Matrix& slopes, const Joined::JoinedInterface& interface,
                                  Index first, double stiffest_spring) const;
  [[nodiscard]] double stiffest_spring(const Matrix& slopes) const;
  [[nodiscard]] double reduction(const Matrix& slope, Index first, double stiffest_spring) const;
  [[nodiscard]] bool own_tangents(const std::vector<Matrix>& slopes, Matrix& stiffness) const;
  void subtract_sides(const Matrix& rows, Matrix& jumps) const;
  void add_to_sides(const Matrix& between, Matrix& rows) const;
  void add_spring_forces(const Matrix& stiffness, const Matrix& jumps, Matrix& forces) const;
  void add_body_forces(const Matrix& moved, Matrix& forces) const;
  [[nodiscard]] Matrix best_in(const Matrix& basis, const Matrix& stiffness, const Vector& holding,
                               const Matrix& load) const;
  void combine();
  void invert();
  [[nodiscard]] SparseRows joined_springs() const;
  [[nodiscard]] SparseColumns assemble() const;
  [[nodiscard]] Matrix assemble_dense() const;
  void factorise_dense();
  void factorise_sparse();
  void hold_with(double hold);

  /// Rows of this rank of a table of all.
  [[nodiscard]] auto own(const Matrix& all) const {
    return all.middleRows(joined_->first_row(), structure_.rows());
  }

  const Structure& structure_;
  std::shared_ptr<const Joined> joined_;
  Index active_;
  double hold_ = 0.0;
  Vector holding_;                ///< springs that hold the bodies, (rows)
  SparseRows traces_;             ///< T, (rows, active)
  SparseRows jumps_;              ///< J, (unknowns, active)
  SparseRows sides_;              ///< J', (unknowns, rows)
  SparseRows to_unknowns_;        ///< T^T
  std::vector<Index> component_;  ///< (unknowns)
  Vector areas_;                  ///< (unknowns)
  Vector flexibility_;            ///< (unknowns)
  bool softened_ = false;
  Vector rigid_;           ///< what slopes are reduced by, (unknowns)
  Vector springs_;         ///< the same at most, where there are stiff springs
  Matrix slopes_;          ///< of the last factorisation
  Index most_components_;  ///< columns of these
  SparseRows tangent_;     ///< W K, (unknowns, unknowns)
  // what a correction takes beside the factor: (active, rows), (rows, active), (rows, rows)
  SparseRows load_;
  SparseRows of_answer_;
  SparseRows of_residual_;
  bool dense_ = false;
  bool symmetric_ = true;
  // one of these, as it is dense and symmetric or not
  Eigen::LLT<Matrix> cholesky_;
  Eigen::PartialPivLU<Matrix> lu_;
  std::unique_ptr<algebra::Factor> factor_;
  Matrix inverse_;    ///< where it is dense, after many columns
  Index solved_ = 0;  ///< columns with this factorisation
  std::unique_ptr<algebra::GeneralFactor> general_;
};

}  // namespace latin::substructure
