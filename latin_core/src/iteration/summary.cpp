#include "latin/iteration/summary.hpp"

#include <array>

namespace latin::iteration {

std::string to_string(Status status) {
  switch (status) {
    case Status::converged:
      return "converged";
    case Status::inexact:
      return "inexact";
    case Status::max_iterations:
      return "max_iterations";
    case Status::undecided:
      return "undecided";
    case Status::undetermined:
      return "undetermined";
    case Status::slides:
      return "slides";
    case Status::no_equilibrium:
      return "no_equilibrium";
    case Status::time_limit:
      return "time_limit";
    case Status::interrupted:
      return "interrupted";
  }
  return "unknown";
}

std::span<const Status> statuses() {
  static constexpr std::array all{
      Status::converged,      Status::inexact,      Status::max_iterations,
      Status::undecided,      Status::undetermined, Status::slides,
      Status::no_equilibrium, Status::time_limit,   Status::interrupted};
  return all;
}

}  // namespace latin::iteration
