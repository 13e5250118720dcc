#include "latin/iteration/summary.hpp"

namespace latin::iteration {

std::string to_string(Status status) {
  switch (status) {
    case Status::converged:
      return "converged";
    case Status::max_iterations:
      return "max_iterations";
    case Status::stagnated:
      return "stagnated";
    case Status::inexact:
      return "inexact";
    case Status::diverged:
      return "diverged";
    case Status::no_equilibrium:
      return "no_equilibrium";
    case Status::interrupted:
      return "interrupted";
  }
  return "unknown";
}

}  // namespace latin::iteration
