#pragma once

#include <exception>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "latin/common/interrupt.hpp"
#include "latin/common/types.hpp"

namespace latin::iteration {

/// How an iteration ended, from the best to the worst.
enum class Status {
  converged,       ///< the estimated error is below the tolerance
  inexact,         ///< what is left is rounding, and more than the tolerance
  max_iterations,  ///< the tolerance was not reached in the allowed iterations
  undecided,  ///< the error stopped falling, or the forces grew beyond any use: no answer was found, nor why not
  undetermined,  ///< parts are free in motions that no load drives: any place is an answer. For callers that know them
  slides,  ///< what the loads move slides on as far as it is let: the steps before that are answers
  no_equilibrium,  ///< no admissible forces balance the loads of a step: those before it are answers
  time_limit,      ///< the seconds that it may take were over
  interrupted      ///< a callback asked for what is done so far
};
std::string to_string(Status status);
/// All of them, in their order.
std::span<const Status> statuses();

/// One iteration as a callback sees it.
struct Iteration {
  Index number;  ///< from 0, of this solve
  double
      error;  ///< estimated relative error (k-free, see Yardstick::relative), infinity while unknown
  double indicator;  ///< the paper's error indicator (depends on k)
  double residual;   ///< |r| in sqrt(W/k), absolute
  double seconds;    ///< since the solve began
};

/// Called after every iteration, and now and then within one that takes long; throws Interrupted to end the run.
using Callback = std::function<void(const Iteration&)>;

/// Whether anything can balance the loads of a column. Collective; asked where something flies, once a column.
using Balanced = std::function<bool(Index)>;

/// What a run did.
struct Summary {
  Status status = Status::max_iterations;
  Index iterations = 0;  ///< global stages, and the work of Newton steps in such
  double error = 0.0;    ///< last estimate
  /// The estimates it is the largest of, of the bodies on this rank: (groups, bodies), see
  /// substructure::ColumnGroups.
  Matrix errors;
  /// Of a sample: scatter of the body between the samples so far, relative to its size, whose errors are the largest
  /// relative to it (all bodies' largest error is divided by it); 1 where it is not asked for or not known.
  double scatter = 1.0;
  double indicator = 0.0;
  double energy =
      0.0;  ///< u^T K u of the bodies and springs, or their strain energy if that is less, all columns
  double global_s = 0.0;
  double local_s = 0.0;
  double flexibility_s = 0.0;  ///< the dense flexibility of Newton steps, where it was made
  double newton_s = 0.0;       ///< tangents and dense systems of Newton steps
  double check_s = 0.0;        ///< checks of estimates, and what is solved for at once
  double callback_s = 0.0;     ///< in the caller's functions
  double other_s = 0.0;        ///< acceleration and error measure
  Index newton_steps = 0;      ///< of single columns
  Index restarts = 0;          ///< times the safeguard dropped the history
  Vector
      falls;  ///< (columns), or empty: by what share of itself the load falls where bonds tear, see Newton
  std::vector<Iteration> history;

  /// How it ended, in one line without its end.
  [[nodiscard]] std::string brief() const;
  /// The same, and lines of what it took, of its errors by group and of loads that fall.
  [[nodiscard]] std::string full() const;
};

}  // namespace latin::iteration
