#include "iteration/stopping_rule.hpp"

#include <algorithm>
#include <cmath>

namespace latin::iteration {
namespace {

/// A residual so much larger than the first one is beyond any use.
constexpr double beyond_use = 1e10;
/// Progress is a residual or an error that fell to this share of what it was when progress was last seen.
constexpr double share_of_progress = 0.9;

}  // namespace

std::optional<Status> StoppingRule::judge(const Iteration& iterate, std::optional<Status> stop) {
  if (first_residual_ < 0.0) {
    first_residual_ = iterate.residual;
  }
  if (!std::isfinite(iterate.residual) || iterate.residual > beyond_use * first_residual_) {
    return Status::undecided;
  }
  if ((options_.stop_on_indicator ? iterate.indicator : iterate.error) <= options_.rtol) {
    return Status::converged;
  }
  if (stop) {
    return stop;
  }
  if (iterate.number >= options_.max_iterations) {
    return Status::max_iterations;
  }
  if (iterate.residual < share_of_progress * residual_then_ ||
      iterate.error < share_of_progress * error_then_) {
    last_progress_ = iterate.number;
    residual_then_ = std::min(iterate.residual, residual_then_);
    error_then_ = std::min(iterate.error, error_then_);
  } else if (iterate.number - last_progress_ > options_.stagnation_window) {
    return Status::undecided;
  }
  return std::nullopt;
}

void StoppingRule::forget() {
  if (!(first_residual_ > 0.0)) {
    first_residual_ = -1.0;
  }
  residual_then_ = std::numeric_limits<double>::infinity();
  error_then_ = std::numeric_limits<double>::infinity();
}

}  // namespace latin::iteration
