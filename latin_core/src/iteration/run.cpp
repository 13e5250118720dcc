#include "latin/iteration/run.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace latin::iteration {
namespace {

using substructure::Laws;
using Clock = std::chrono::steady_clock;

constexpr double unknown = std::numeric_limits<double>::infinity();
/// Depth of the history that only observes, where nothing is accelerated. A plain run needs all of it before its
/// error estimate is believed, an accelerated one a single step: slow parts of an error hide behind fast ones at
/// first, and snapshots share the errors that were left in all of them.
constexpr Index observing_depth = 10;
/// Accelerated steps so much longer than the residual are not taken where a body may fly off.
constexpr double longest_step = 1e7;
/// Plain steps from zero, where Newton's method may take over.
constexpr Index steps_from_zero = 2;
/// Accuracy of Newton's method, as a share of that of the run.
constexpr double newton_accuracy = 1e-3;
/// The residual falls by so much more than the error in a Newton step (measured: 0.1 to 6).
constexpr double residual_over_error = 2.0;

/// Whether some law is nonlinear, so that a body may lose touch. Collective.
bool may_fly(const Laws& laws) {
  return laws.structure().communicator().maximum(laws.linear() ? 0 : 1) > 0;
}

NewtonProposal::Solver newton_of(Stages& stages, const Options& options) {
  if (options.acceleration < 1 || options.newton < 1) {
    return {};
  }
  return stages.newton(newton_accuracy * options.rtol);
}

}  // namespace

Run::Run(const Laws& laws, const Options& options, const Matrix& amplitudes, State& state,
         std::size_t snapshots, const Callback& callback)
    : structure_(laws.structure()),
      options_(options),
      state_(state),
      callback_(callback),
      residual_(Matrix::Zero(structure_.rows(), amplitudes.cols())),
      stages_(laws, amplitudes, options.single_precision),
      history_(
          metric_of(structure_), amplitudes.cols(),
          (accelerates() ? options.acceleration : observing_depth) + static_cast<Index>(snapshots)),
      stepper_(stages_.fixed_point(), history_, options.relaxation,
               may_fly(laws) ? longest_step : unknown),
      error_(gauge_of(structure_), structure_.rows(), amplitudes.cols(),
             accelerates() ? 1 : observing_depth),
      newton_(history_.metric(), newton_of(stages_, options),
              [this](const State& at, Matrix& residual) {
                stages_.local(at.data, at.traces, residual);
              }),
      stopping_(options) {}

void Run::start_from(const std::vector<const State*>& snapshots) {
  stepper_.start_from(snapshots, at());
  stages_.set_exact(false);
}

Summary Run::run(bool traces_known) {
  if (structure_.total_rows() == 0) {
    summary_.status = Status::converged;
    summary_.energy = stages_.size(state_).strain;
    return summary_;
  }
  begin(traces_known);
  for (;;) {
    const Measured measured = observe();
    const std::optional<Status> status = stopping_.judge(
        summary_.history.back(), stop_ || (interrupted_ && structure_.communicator().alone()));
    if (!status) {
      advance(measured);
    } else if (*status == Status::converged && !stages_.exact() &&
               iterations() < options_.max_iterations) {
      // what was small before was so in single precision, or in a start, only
      stages_.evaluate(at());
      safeguard_.forget();
      stopping_.forget();
    } else {
      finish(*status, measured);
      return summary_;
    }
  }
}

void Run::begin(bool traces_known) {
  if (traces_known) {
    stages_.local(state_.data, state_.traces, residual_);
  } else {
    stages_.evaluate(at());
  }
  const bool from_zero = state_.data.isZero(0.0);
  newton_.begin(from_zero, structure_.interface_unknowns());
  safeguard_.pause(newton_.possible() && from_zero ? steps_from_zero : 0);
}

/// Measure the iterate, and tell the caller.
Measured Run::observe() {
  newton_.withdraw();
  if (newton_.due()) {
    propose();
  }
  stop_ = interrupted_;
  const Measured measured = stages_.measure(at(), history_, error_, stop_);
  double error = estimate(measured);
  if (error <= options_.rtol && !newton_.made() && newton_.failed_before()) {
    propose();  // an accelerated run that was long may hide an error that Newton's step shows
    error = estimate(measured);
  }
  report(error, measured);
  return measured;
}

void Run::report(double error, const Measured& measured) {
  summary_.error = error;
  summary_.indicator = measured.indicator;
  summary_.energy = measured.whole.strain;
  summary_.history.push_back(
      {iterations(), error, measured.indicator, measured.residual, elapsed()});
  if (!callback_) {
    return;
  }
  const Timed timed(callback_s_);
  stages_.attempt([this] {
    try {
      callback_(summary_.history.back());
    } catch (const Interrupted&) {
      interrupted_ = true;
    }
  });
}

double Run::estimate(const Measured& measured) {
  if (measured.residual == 0.0) {
    return 0.0;
  }
  if (const auto left = newton_.left(measured.residual, measured.data)) {
    return error_.by_step(newton_.step(), *left, measured);
  }
  if (!error_.ready() || safeguard_.plain()) {
    return unknown;
  }
  return error_.by_history(history_, state_, measured);
}

/// One step, to where Newton's method leads or by the history.
void Run::advance(const Measured& measured) {
  if (follow(measured)) {
    return;
  }
  newton_.count_step();
  Stepper::Kind kind = Stepper::Kind::plain;
  if (accelerates()) {
    if (safeguard_.guard(iterations(), measured.residual, measured.rounding(), at())) {
      history_.clear();
    }
    kind = safeguard_.plain() ? Stepper::Kind::averaged : Stepper::Kind::accelerated;
    safeguard_.count_step();
  }
  stepper_.step(kind, at());
  error_.count_step();
}

void Run::propose() {
  const double before = stages_.local_seconds();
  NewtonOutcome outcome;
  {
    const Timed timed(summary_.newton_s);
    outcome = newton_.propose(at());
  }
  summary_.newton_s -= stages_.local_seconds() - before;
  newton_stages_ += static_cast<Index>(std::ceil(outcome.stages));
  summary_.newton_steps += outcome.steps;
}

bool Run::follow(const Measured& measured) {
  if (!newton_.follow(measured.residual, measured.data, at())) {
    return false;
  }
  if (newton_.whole()) {
    stages_.set_exact(true);
  }
  history_.clear();
  error_.restart();
  safeguard_.jumped(iterations(), newton_.residual_norm(), at());
  return true;
}

void Run::finish(Status status, const Measured& measured) {
  if (status == Status::converged && newton_.whole() && follow(measured)) {
    // the estimate was of the iterate before; errors fall less than residuals do
    summary_.error *=
        std::min(residual_over_error * newton_.residual_norm() / measured.residual, 1.0);
  }
  stages_.agree();
  if (!stages_.exact()) {
    stages_.refresh(state_);
  }
  summary_.status = status;
  summary_.iterations = iterations();
  summary_.restarts = safeguard_.restarts();
  summary_.global_s = stages_.global_seconds();
  summary_.local_s = stages_.local_seconds();
  summary_.other_s =
      elapsed() - callback_s_ - summary_.global_s - summary_.local_s - summary_.newton_s;
}

double Run::elapsed() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }

}  // namespace latin::iteration
