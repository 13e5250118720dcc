#pragma once

#include <limits>
#include <optional>

#include "latin/common/types.hpp"
#include "latin/iteration/options.hpp"
#include "latin/iteration/summary.hpp"

namespace latin::iteration {

/// Whether a run has ended, and how, from the numbers measured of its iterates.
class StoppingRule {
 public:
  explicit StoppingRule(const Options& options) : options_(options) {}

  /// To be asked once for every iterate.
  /// @param stop as what it ends here, because someone wants what is done so far; nothing: nobody does
  /// @return nothing: go on
  [[nodiscard]] std::optional<Status> judge(const Iteration& iterate, std::optional<Status> stop);
  /// Earlier numbers are not to be compared with what comes.
  void forget();

 private:
  Options options_;
  double first_residual_ = -1.0;
  // when progress was last seen
  double residual_then_ = std::numeric_limits<double>::infinity();
  double error_then_ = std::numeric_limits<double>::infinity();
  Index last_progress_ = 0;
};

}  // namespace latin::iteration
