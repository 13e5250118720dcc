#include "iteration/safeguard.hpp"

#include <algorithm>

namespace latin::iteration {
namespace {

/// An accelerated residual this much above the best one so far is not followed any further.
constexpr double growth_before_restart = 10.0;
/// Accelerated iterations without a better residual before the safeguard steps in.
constexpr Index longest_circle = 15;
constexpr Index longest_pause = 64;

}  // namespace

bool Safeguard::guard(Index iteration, double norm, double rounding, Iterate at) {
  const bool led_astray = norm > growth_before_restart * best_norm_;
  const bool circling = iteration - best_at_ > longest_circle && pause_ == 0;
  const bool at_rest = norm <= rounding;
  if (!(led_astray || circling) || at_rest) {
    remember(iteration, norm, at);
    return false;
  }
  best_at_ = iteration;
  if (trapped_) {
    best_norm_ = norm;
    best_ = at.state;
    best_residual_ = at.residual;
  } else {
    at.state = best_;
    at.residual = best_residual_;
  }
  trapped_ = !trapped_;
  pause_ = plain_steps_;
  plain_steps_ = std::min<Index>(2 * plain_steps_, longest_pause);
  ++restarts_;
  return true;
}

bool Safeguard::restore(Iterate at) const {
  if (!kept_) {
    return false;
  }
  at.state = best_;
  at.residual = best_residual_;
  return true;
}

void Safeguard::jumped(Index iteration, double norm, Iterate at) {
  pause_ = 0;
  forget();
  remember(iteration, norm, at);
}

void Safeguard::remember(Index iteration, double norm, Iterate at) {
  if (norm < best_norm_) {
    best_at_ = iteration;
    best_norm_ = norm;
    best_ = at.state;
    best_residual_ = at.residual;
    kept_ = true;
    trapped_ = false;
  }
}

}  // namespace latin::iteration
