#pragma once

#include <utility>
#include <vector>

#include "latin/common/types.hpp"
#include "latin/iteration/joined_system.hpp"
#include "latin/iteration/newton_proposal.hpp"
#include "latin/iteration/state.hpp"

namespace latin::iteration {

/// The two stages of one column, solved in a growing space of interface data.
///
/// The global stage is linear and the same in every column: the traces of a change V c of the data are (A V) c once
/// A V is known. So the residual r(s + V c) costs local stages only, and Gauss and Newton make it smallest over c with
/// the laws themselves, whatever branches they go through. What is left of it is the next direction: one global stage.
/// With laws that stay on one branch this is GMRES on the tangent of that branch. The space stays from one column, and
/// from one call, to the next.
class Subspace {
 public:
  /// @param system must outlive this object
  explicit Subspace(const JoinedSystem& system);

  /// Solve column after column, until one of them fails. Collective, as all members are.
  /// @param state of the iterate; replaced in the columns that are solved, and in the one that is not
  /// @param tolerance on the residual, relative to the largest column of the data
  NewtonOutcome solve(State& state, const Matrix& amplitudes, double tolerance);
  /// Global stages of single columns so far, and minimisations of Gauss and Newton.
  [[nodiscard]] Index stages() const { return stages_; }
  [[nodiscard]] Index steps() const { return steps_; }
  /// Directions that are kept at most.
  static constexpr Index most_directions = 120;

 private:
  /// A column where the search is.
  struct Point {
    State state;
    Matrix jump;
    Vector residual;
    double norm = 0.0;
  };
  [[nodiscard]] Point at(Index column, const JoinedSystem::Memory& before, State state) const;
  /// Make the residual of one column smaller.
  /// @param state     of all ranks (rows, 1) data and traces, replaced by the best found
  /// @param before    of the columns before
  /// @param tolerance on the norm of the residual
  /// @param most      global stages
  /// @return whether the tolerance was reached
  bool improve(Index column, const JoinedSystem::Memory& before, State& state, double tolerance,
               Index most);

  /// Norm of data or residuals.
  [[nodiscard]] double norm(ConstMatrixRef block) const;
  /// Norm of the residual of a column, (rows, 1).
  [[nodiscard]] double residual_norm(Index column, const JoinedSystem::Memory& before,
                                     const State& state) const;
  NewtonOutcome solve_all(State& state, const Matrix& amplitudes, double tolerance);
  /// One step of Gauss and Newton in the space. @return whether the residual fell by enough to go on
  bool step(Index column, const JoinedSystem::Memory& before, Point& point);
  /// A direction more. @return whether it is new
  bool grow(const Vector& direction);
  bool add(Matrix data, Matrix traces);

  const JoinedSystem& system_;
  std::vector<std::pair<Index, Index>> bodies_;  ///< first row and rows of each
  Vector weights_;                               ///< W/k, of the metric
  Matrix data_;    ///< V, (rows, most_directions), orthonormal in the metric
  Matrix traces_;  ///< A V
  Index size_ = 0;
  Index stages_ = 0;
  Index steps_ = 0;
};

}  // namespace latin::iteration
