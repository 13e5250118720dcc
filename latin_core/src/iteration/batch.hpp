#pragma once

#include <vector>

#include "iteration/solver.hpp"

namespace latin::iteration {

/// A point of a sweep after one iteration.
struct Advanced {
  State state;
  Matrix errors;           ///< as `Summary::errors`; empty where they are not known
  double error = 0.0;      ///< as `Summary::error`; infinity where the history explains too little
  double indicator = 0.0;  ///< as `Summary::indicator`
  double residual = 0.0;
  double energy = 0.0;
};

/// One iteration for many parameter sets at once, all from the best combination of the same snapshots: what
/// `solve` does with a point whose first iterate already is the answer, with the columns of all points
/// in one global stage. There a matrix is read once and not once a point.
///
/// @param laws       parameters of all sets side by side, the columns of a set together
/// @param sets       parameter sets
/// @param snapshots  two states or more, (rows, c) each; with a basis one is enough
/// @param amplitudes (loads, c), the same for all sets
/// @param known      the structure linearised at a near set: the iteration is a step of Newton's method then, and its
///                   error what the next one would change; null: one step of the two stages
/// @param basis      not null, of linear laws on one rank: no iteration, but the answers, from the first snapshot,
///                   which must be the same as long as the basis is. What few points have moved by is added to it,
///                   and others are looked for in it first
/// @throws InputError naming an interface whose columns are transformed
std::vector<Advanced> advance_together(const substructure::Laws& laws, const Options& options,
                                       const Matrix& amplitudes, Index sets,
                                       const std::vector<const State*>& snapshots,
                                       const Linearisation* known = nullptr,
                                       Matrix* basis = nullptr);

}  // namespace latin::iteration
