#pragma once

#include <limits>

#include "latin/common/types.hpp"

namespace latin::iteration {

/// All settings of the iteration. Defaults are here and nowhere else: latin_core.Options takes them over.
struct Options {
  double rtol = 1e-6;  ///< tolerance on the measure below
  bool stop_on_indicator =
      false;  ///< false: the k-free error estimate; true: the paper's indicator
  Index max_iterations = 500;
  Index acceleration = 10;  ///< depth of Anderson's history; 0: the plain iteration
  double relaxation = 1.0;  ///< mu in (0, 1]: s <- s + mu r (and of Anderson's remainder)
  Index stagnation_window =
      100;  ///< iterations without progress after which a run ends as undecided
  double max_seconds = std::numeric_limits<double>::infinity();  ///< of a solve, or a whole sweep
  /// Newton's method begins after one accelerated step less than this. 0: where the run would give up, if at all.
  Index newton = 1;
  Index snapshots = 15;  ///< earlier states combined for the start of a new point; 1: the nearest
  Index together = 8;    ///< points of a sweep that may be tried side by side, at least 1
  /// Points of a sweep are samples: what they scatter by is to be as right as they are.
  bool scatter = false;
  /// Global stages on the steps alone, in single precision; an iterate is only accepted with its traces in
  /// double precision.
  bool single_precision = false;

  /// @throws InputError naming the first that is out of range
  void check() const;
};

}  // namespace latin::iteration
