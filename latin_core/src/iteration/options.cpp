#include "latin/iteration/options.hpp"

#include <string>
#include <utility>

#include "latin/common/error.hpp"

namespace latin::iteration {

void Options::check() const {
  const auto demand = [](bool holds, const std::string& text) {
    if (!holds) {
      throw InputError(text);
    }
  };
  demand(rtol > 0.0 && rtol < 1.0, "rtol is " + std::to_string(rtol) + ": it must lie in (0, 1)");
  demand(max_iterations >= 1,
         "max_iterations is " + std::to_string(max_iterations) + ": it must be at least 1");
  for (const auto& [name, value] : {std::pair{"stagnation_window", stagnation_window},
                                    {"snapshots", snapshots},
                                    {"together", together}}) {
    demand(value >= 1, name + (" is " + std::to_string(value)) + ": it must be at least 1");
  }
  demand(max_seconds >= 0.0,
         "max_seconds is " + std::to_string(max_seconds) + ": it must not be negative");
  demand(newton >= 0, "newton is " + std::to_string(newton) + ": it must not be negative");
  demand(acceleration >= 0 && acceleration <= 100,
         "acceleration is " + std::to_string(acceleration) + ": it must lie in 0..100");
  demand(relaxation > 0.0 && relaxation <= 1.0,
         "relaxation is " + std::to_string(relaxation) + ": it must lie in (0, 1]");
}

}  // namespace latin::iteration
