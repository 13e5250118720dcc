#include "latin/iteration/summary.hpp"

#include <array>
#include <cmath>
#include <sstream>
#include <utility>

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

std::string Summary::brief() const {
  std::ostringstream text;
  text.precision(2);
  text << to_string(status) << " after " << iterations << " iterations, estimated error ";
  if (std::isfinite(error)) {
    text << error;
  } else {
    text << "not known";
  }
  return text.str();
}

std::string Summary::full() const {
  std::ostringstream text;
  text.precision(3);
  text << brief() << "\nNewton steps " << newton_steps << ", restarts " << restarts
       << ", indicator " << indicator << ", energy " << energy << "\nseconds:";
  for (const auto& [phase, seconds] : {std::pair{" global stages ", global_s},
                                       {", local stages ", local_s},
                                       {", flexibility ", flexibility_s},
                                       {", Newton steps ", newton_s},
                                       {", checks ", check_s},
                                       {", callbacks ", callback_s},
                                       {", other ", other_s}}) {
    text << phase << seconds;
  }
  for (Index group = 0; group < errors.rows(); ++group) {
    text << "\nerrors of group " << group << ": " << errors.row(group);
  }
  if (falls.size() > 0) {
    text << "\nthe load falls by " << falls.transpose();
  }
  return text.str();
}

}  // namespace latin::iteration
