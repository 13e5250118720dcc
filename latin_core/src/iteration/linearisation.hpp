#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "iteration/error_estimate.hpp"
#include "latin/common/types.hpp"
#include "latin/iteration/state.hpp"
#include "substructure/laws.hpp"
#include "substructure/local_stage.hpp"
#include "substructure/size.hpp"
#include "substructure/tangent.hpp"

namespace latin::iteration {

/// The structure linearised at the columns of a state: those with the same tangents share a factorisation.
///
/// It may be kept from one parameter set to the next: steps with tangents of a near set are nearly as good. It is that
/// of all ranks, on each of them: whatever takes a state or a residual is collective. A copy has the same tangents
/// until one of the two takes others.
class Linearisation {
 public:
  static constexpr double least_hold = substructure::Tangent::least_hold;

  /// Tangents whose stiffnesses differ by no more than this factor are near.
  static constexpr double near_factor = 3.0;

  /// Whether steps of linear laws are not exact, for rigid connections were made springs.
  [[nodiscard]] bool softened() const {
    return std::ranges::any_of(tangents_, [](const auto& each) { return each->softened(); });
  }
  /// Whether it is of this structure, or of none yet.
  [[nodiscard]] bool fits(const substructure::Laws& laws) const {
    return structure_ == nullptr || structure_ == laws.shared_structure();
  }
  [[nodiscard]] bool made() const { return !slopes_.empty() && hold_ == least_hold; }
  /// Take the tangents of a state.
  /// @param hold springs on all bodies, relative to the search direction
  /// @return whether they have changed
  /// @throws NumericalError if the structure is not stable with them
  bool take(const substructure::Laws& laws, const State& state, double hold = least_hold);
  /// The same with the tangents transposed, for adjoint systems: friction makes them unsymmetric. What is measured
  /// afterwards has no meaning.
  /// @throws NumericalError if the structure is not stable with them
  void take_transposed(const substructure::Laws& laws, const State& state);
  /// Whether the tangents of a state, of c columns or of several sets of them, are so near to these that no motion
  /// is soft in one and stiff in the other.
  [[nodiscard]] bool near(const substructure::Laws& laws, const State& state) const;
  /// The largest factor between a stiffness there and here, of every column; of a chaos, of its means, (steps).
  /// Of linear laws no error in energy is larger, nor smaller, than this times what a step with these tangents says:
  /// it bounds the eigenvalues of one stiffness relative to the other.
  [[nodiscard]] std::vector<double> contrasts(const substructure::Laws& laws,
                                              const State& state) const;
  /// Residual (rows, c) into the step on the data, in place; c may be several sets of columns.
  /// @param moved what the step does to the traces, (rows, c)
  void correct(MatrixRef residual, Matrix& moved) const;
  /// The same with the tangents of every column's own, of linear laws on one rank: see Tangent::correct_each().
  Matrix correct_each(const substructure::Laws& laws, const State& state, const Matrix& basis,
                      const Vector& fall, MatrixRef residual, Matrix& moved) const;
  /// The same of a chaos with linear laws, whose columns random stiffnesses couple: see Coupled::correct().
  double correct_coupled(substructure::LocalStage& local, double tolerance, int round,
                         Vector& energies, MatrixRef residual, Matrix& moved) const;
  /// What rounding of forces and displacements may do to a state, relative to it: (groups, bodies). It is not found
  /// again for another one, until other tangents are taken. Guessed, and measured of bodies that rounding leaves
  /// little of.
  const Matrix& rounding(const substructure::Laws& laws, const State& state,
                         ConstMatrixRef amplitudes, const Whole& whole);
  /// What is known of it: empty if nothing is.
  [[nodiscard]] const Matrix& known_rounding() const { return rounding_; }
  void forget_rounding() { rounding_.resize(0, 0); }
  /// Forces per area (rows, c) as the meshes see them, on the active unknowns of the bodies, (active, c).
  [[nodiscard]] Matrix nodal(const Matrix& forces) const {
    return tangents_.front()->nodal(forces);
  }
  /// The largest difference between the forces of the two stages that the meshes see, relative to these forces: of
  /// any body in any column.
  /// @param rounding differences below this fraction of the data of a body are none
  [[nodiscard]] double imbalance(const substructure::Laws& laws, const State& state,
                                 const Matrix& residual, double rounding = 0.0) const;

 private:
  struct Slopes {
    std::vector<Matrix> distinct;
    std::vector<std::size_t> of_column;
  };
  [[nodiscard]] Matrix measured(const substructure::Laws& laws, const State& state,
                                ConstMatrixRef amplitudes) const;
  [[nodiscard]] substructure::Sizes rounding_sizes(const substructure::Laws& laws,
                                                   const State& state,
                                                   ConstMatrixRef amplitudes) const;
  [[nodiscard]] Slopes slopes_of(const substructure::Laws& laws, const State& state) const;
  void factorise(const std::vector<Matrix>& slopes, double hold, const Communicator& communicator);
  void know_structure(const substructure::Laws& laws);
  bool take(const substructure::Laws& laws, Slopes now, double hold, double share);

  std::shared_ptr<const substructure::Structure> structure_;  ///< tangents look at it
  std::vector<std::shared_ptr<substructure::Tangent>>
      tangents_;                ///< of each distinct linearisation
  std::vector<Matrix> slopes_;  ///< of each of these
  std::vector<std::size_t> of_column_;
  double hold_ = 0.0;
  Matrix rounding_;  ///< empty: not known
};

}  // namespace latin::iteration
