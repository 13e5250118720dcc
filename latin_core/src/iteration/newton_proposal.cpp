#include "iteration/newton_proposal.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "latin/common/error.hpp"

namespace latin::iteration {
namespace {

/// From zero Newton's method marches at once. From elsewhere (another parameter set) accelerated steps often do alone,
/// and cost less than factorisations: so many for each of the unknowns as cost as much as a proposal, but no more than
/// so many. None waits for more than this fraction of all iterations.
constexpr double steps_per_unknown = 0.5;
constexpr double most_worth = 300.0;
constexpr double share_of_iterations = 0.5;
/// Accelerated steps after Newton's method failed; twice as many after the next time.
constexpr Index steps_after_failure = 8;
/// A proposal that leaves less than this of the residual is the error of the iterate before it.
constexpr double believable = 0.5;
/// A step so much larger than the data is a body that flies off.
constexpr double absurd = 1e6;
/// Below this share of the data the residual need not fall.
constexpr double settled_norm = 1e-10;

}  // namespace

NewtonProposal::NewtonProposal(Metric metric, Solver solver, Residual residual)
    : metric_(std::move(metric)),
      solver_(std::move(solver)),
      residual_of_(std::move(residual)),
      wait_after_failure_(steps_after_failure) {}

void NewtonProposal::begin(bool from_zero, Index unknowns, Index most_iterations, Index patience) {
  if (patience < 1) {
    wait_ = std::numeric_limits<Index>::max();
    return;
  }
  auto wait = static_cast<double>(patience - 1);
  if (!from_zero) {
    wait = std::max(wait, std::min(steps_per_unknown * static_cast<double>(unknowns), most_worth));
  }
  const double room = share_of_iterations * static_cast<double>(most_iterations);
  wait_ = static_cast<Index>(std::clamp(wait, 0.0, room));
}

NewtonOutcome NewtonProposal::propose(Iterate from, Index most) {
  if (!possible()) {
    return {};
  }
  const double size = metric_.norm(from.residual);  // of all ranks
  if (!std::isfinite(size) || size == 0.0) {
    return {};
  }
  tried_ = true;
  State proposal = from.state;
  NewtonOutcome outcome;
  try {
    outcome = solver_(proposal, most);
  } catch (const NumericalError&) {
    solver_ = {};  // a body without a usable flexibility: the accelerated iteration goes on alone
    return {};
  }
  made_ = true;
  columns_ = outcome.solved;
  lost_ = outcome.lost;
  hangs_on_nothing_ = outcome.hangs_on_nothing;
  step_.data = proposal.data - from.state.data;
  step_.traces = proposal.traces - from.state.traces;
  residual_.resize(step_.data.rows(), step_.data.cols());
  residual_of_(proposal, residual_);
  length_ = metric_.norm(step_.data);
  norm_ = metric_.norm(residual_);
  return outcome;
}

bool NewtonProposal::sane(double residual, double data) const {
  return length_ < absurd * (residual + data);
}

std::optional<double> NewtonProposal::left(double residual, double data) const {
  if (!whole() || !sane(residual, data)) {
    return std::nullopt;
  }
  const double share = norm_ > settled_norm * data ? norm_ / residual : 0.0;
  return share < believable ? std::optional(share) : std::nullopt;
}

bool NewtonProposal::follow(double residual, double data, Iterate at) {
  if (!made_) {
    return false;
  }
  const bool all = whole();
  const bool good = sane(residual, data) && (all ? norm_ < residual : columns_ > solved_);
  if (!all || !good) {
    ++failures_;
    wait_ = wait_after_failure_;
    wait_after_failure_ *= 2;
  }
  if (!good) {
    return false;
  }
  solved_ = columns_;
  at.state.data += step_.data;
  at.state.traces += step_.traces;
  at.residual.swap(residual_);
  return true;
}

}  // namespace latin::iteration
