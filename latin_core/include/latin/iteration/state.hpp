#pragma once

#include "latin/common/types.hpp"

namespace latin::iteration {

/// Interface data and their traces: the whole state of the method.
struct State {
  Matrix data;    ///< s (rows, c)
  Matrix traces;  ///< w (rows, c)
};

/// Where an iteration is: a state, and the residual r = G(s) - s (rows, c) of the two stages there.
struct Iterate {
  State& state;
  Matrix& residual;
};

}  // namespace latin::iteration
