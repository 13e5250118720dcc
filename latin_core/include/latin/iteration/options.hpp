#pragma once

#include "latin/common/types.hpp"

namespace latin::iteration {

/// All settings of the iteration. Defaults are in Python (latin_core.Options), nowhere else.
struct Options {
  double rtol;             ///< tolerance on the measure below
  bool stop_on_indicator;  ///< false: the k-free error estimate; true: the paper's indicator
  Index max_iterations;
  Index acceleration;       ///< depth of Anderson's history; 0: the plain iteration
  double relaxation;        ///< mu in (0, 1]: s <- s + mu r (and of Anderson's remainder)
  Index stagnation_window;  ///< iterations without progress before the run is called stagnated
  Index newton;             ///< whether Newton steps are taken; 0: never
  Index snapshots;  ///< earlier states combined for the start of a new point; 1: the nearest alone
  Index together = 1;  ///< points of a sweep that may be tried side by side, at least 1
  /// Points of a sweep are samples: what they scatter by is to be as right as they are.
  bool scatter = false;
  /// Global stages on the steps alone, in single precision; an iterate is only accepted with its traces in
  /// double precision.
  bool single_precision = false;

  /// @throws InputError naming the first that is out of range
  void check() const;
};

}  // namespace latin::iteration
