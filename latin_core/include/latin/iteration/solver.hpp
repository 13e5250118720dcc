#pragma once

#include <exception>
#include <functional>
#include <string>
#include <vector>

#include "latin/iteration/history.hpp"
#include "latin/substructure/laws.hpp"

namespace latin::iteration {

/// How an iteration ended.
enum class Status {
  converged,       ///< the estimated error is below the tolerance
  max_iterations,  ///< the tolerance was not reached in the allowed iterations
  stagnated,       ///< the error stopped falling: rounding, or a direction far off
  diverged,        ///< the residual grew beyond any use, or became NaN
  interrupted      ///< a callback asked for what is done so far
};
std::string to_string(Status status);

/// All settings of the iteration. Defaults are in Python (latin_core.Options), nowhere else.
struct Options {
  double rtol;             ///< tolerance on the measure below
  bool stop_on_indicator;  ///< false: the k-free error estimate; true: the paper's indicator
  Index max_iterations;
  Index acceleration;       ///< depth of Anderson's history; 0: the plain iteration
  double relaxation;        ///< mu in (0, 1]: s <- s + mu r (and of Anderson's remainder)
  Index stagnation_window;  ///< iterations without progress before the run is called stagnated
  Index newton;             ///< most interface unknowns for which Newton steps are taken; 0: never
  Index snapshots;  ///< earlier states combined for the start of a new point; 0: the nearest alone
  Index together = 1;  ///< points of a sweep that may be tried side by side
  /// Global stages on the steps alone, in single precision; an iterate is only accepted with its traces in
  /// double precision.
  bool single_precision = false;
};

/// One iteration as a callback sees it.
struct Iteration {
  Index number;  ///< from 0, of this solve
  double
      error;  ///< estimated relative error (k-free, see Size::relative_to), infinity while unknown
  double indicator;  ///< the paper's error indicator (depends on k)
  double residual;   ///< |r| in sqrt(W/k), absolute
  double seconds;    ///< since the solve began
};

/// A callback throws it to end the run with what is done so far; on several ranks, that of any of them does.
class Interrupted : public std::exception {
 public:
  [[nodiscard]] const char* what() const noexcept override { return "interrupted"; }
};

/// Called after every iteration; may throw to end the run.
using Callback = std::function<void(const Iteration&)>;

struct Summary {
  Status status = Status::max_iterations;
  Index iterations = 0;  ///< global stages, and the work of Newton steps in such
  double error = 0.0;    ///< last estimate
  double indicator = 0.0;
  double energy = 0.0;  ///< u^T K u of the bodies with the springs assembled into them, all columns
  double global_s = 0.0;
  double local_s = 0.0;
  double newton_s = 0.0;   ///< tangents and dense systems of Newton steps
  double other_s = 0.0;    ///< acceleration and error measure
  Index newton_steps = 0;  ///< of single columns
  Index restarts = 0;      ///< times the safeguard dropped the history
  std::vector<Iteration> history;
};

/// Iterate to the fixed point from `state` (empty: from zero) and leave the answer in it.
///
/// @param amplitudes (l, c) of the load patterns
/// @param snapshots  states of other parameter sets with the same loads; the start is the affine
///                   combination of them that leaves the smallest residual, at the cost of local stages only
/// @throws InputError on options out of range
Summary solve(const substructure::Laws& laws, const Options& options, const Matrix& amplitudes,
              State& state, const std::vector<const State*>& snapshots, const Callback& callback);

}  // namespace latin::iteration
