#include "iteration/run.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <utility>

#include "common/numbers.hpp"

namespace latin::iteration {
namespace {

using substructure::Laws;
using Clock = std::chrono::steady_clock;

constexpr double unknown_error = std::numeric_limits<double>::infinity();
/// Depth of the history that only observes, where nothing is accelerated. A plain run needs all of it before its
/// error estimate is believed, an accelerated one a single step: slow parts of an error hide behind fast ones at
/// first, and snapshots share the errors that were left in all of them.
constexpr Index observing_depth = 10;
/// Steps of its own that an accelerated run needs where nothing checks its estimate.
constexpr Index own_steps = 3;
/// A search ends when the residual has fallen to this, times the tolerance.
constexpr double search_until = 1e-3;
constexpr Index most_checks = 5;
/// Steps of Newton's method that refine what it has found before a column without equilibrium.
constexpr Index most_refined = 12;
/// Limits below this are not to be exceeded by a search.
constexpr Index least_room = 50;
/// A check that refuted an estimate is repeated when the residual has fallen by this.
constexpr double fall_between_checks = 0.3;
/// Accelerated steps so much longer than the residual are not taken where a body may fly off.
constexpr double longest_step = 1e7;
/// A step does not change the residual by more, relative to itself; from a state of other loads or meshes it does.
constexpr double most_change = 10.0;
/// Plain steps from zero, where Newton's method may take over.
constexpr Index steps_from_zero = 2;
/// Accuracy of what is solved for at once, as a share of that of the run, and how often at most: what rigid laws miss
/// in one round the next one finds.
constexpr double coupled_accuracy = 0.01;
constexpr int most_scalings = 4;
/// Accuracy of Newton's method, as a share of that of the run.
constexpr double newton_accuracy = 1e-3;

/// Whether a run ended without an answer, and not because someone wanted it to.
bool gave_up(Status status) {
  return status == Status::max_iterations || status == Status::undecided;
}

/// Whether Newton's method is asked for, or takes no more than a run without an answer may pay.
bool may_march(const Laws& laws, const Options& options) {
  return (options.acceleration > 0 && options.newton > 0) ||
         substructure::Tangent::bearable(laws.structure());
}

}  // namespace

Run::Run(const Laws& laws, const Options& options, const Matrix& amplitudes, State& state,
         std::size_t snapshots, const Callback& callback, std::shared_ptr<Linearisation> known,
         const Balanced& balanced)
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
               laws.linear_everywhere() ? unknown_error : longest_step),
      error_(gauge_of(laws), structure_.rows(), amplitudes.cols(),
             !accelerates()                                            ? observing_depth
             : Verification::possible(laws) && !laws.scales_anywhere() ? 1
                                                                       : own_steps,
             [this](double error) { return structure_.communicator().largest(error); }),
      newton_(history_.metric(),
              may_march(laws, options)
                  ? stages_.newton(
                        newton_accuracy * options.rtol,
                        [this](Index steps) { return goes_on(steps); }, balanced)
                  : NewtonProposal::Solver(),
              [this](const State& at, Matrix& residual) {
                stages_.local(at.data, at.traces, residual);
              }),
      stopping_(options),
      known_(std::move(known)) {
  stages_.set_accuracy_of_fields(accuracy_of_fields());
}

/// What the equations of bodies with random fields are solved to.
double Run::accuracy_of_fields() const {
  constexpr double exact = substructure::FieldBody::exact;
  return structure_.total_rows() == 0 ? exact : std::max(coupled_accuracy * options_.rtol, exact);
}

void Run::start_from(const std::vector<const State*>& snapshots) {
  stepper_.start_from(snapshots, at());
  stages_.set_exact(false);
  started_elsewhere_ = true;
}

Summary Run::run(bool traces_known) {
  if (structure_.total_rows() == 0) {
    summary_.energy = stages_.strain(state_);
    summary_.status = Status::converged;
    refuse_none();
    return summary_;
  }
  begin(traces_known);
  for (;;) {
    Measured measured = observe();
    if (const auto lost = newton_.lost()) {
      return end_at(*lost);
    }
    std::optional<Status> status = stopping_.judge(summary_.history.back(), wanted_end());
    if (rounding_ && status != Status::interrupted && status != Status::time_limit) {
      status = Status::inexact;
    }
    // as many iterations again, where there is room for any
    if (status && gave_up(*status) && !options_.stop_on_indicator &&
        options_.max_iterations >= least_room) {
      measured = rescue(std::move(measured));
      if (const auto lost = newton_.lost()) {
        return end_at(*lost);
      }
      report(measured);
      if (summary_.error <= options_.rtol) {
        status = Status::converged;
      } else if (rounding_) {
        status = Status::inexact;
      } else if (const auto end = wanted_end()) {
        status = end;
      }
    }
    if (!status) {
      advance(measured);
      if (started_elsewhere_) {
        // displacements of the start may be those of other loads: its residual is nothing to compare with
        started_elsewhere_ = false;
        safeguard_.forget();
        stopping_.forget();
        if (stepper_.first_change() > most_change) {
          // nor is what has become of it, of which the history would say that a step back undoes it
          history_.clear();
          error_.restart();
        }
      }
    } else if (*status == Status::converged && !stages_.exact() &&
               iterations() < options_.max_iterations) {
      // what was small before was so in single precision, or in a start, only
      stages_.evaluate(at());
      safeguard_.forget();
      stopping_.forget();
    } else {
      finish(*status);
      return summary_;
    }
  }
}

/// At a step without equilibrium.
Summary Run::end_at(Status lost) {
  const State others = end_of_march();
  finish(lost);
  state_.data += others.data;
  state_.traces += others.traces;
  return summary_;
}

void Run::begin(bool traces_known) {
  const bool from_zero = structure_.communicator().everywhere(state_.data.isZero(0.0));
  if (accelerates() && options_.newton >= 1 && verifies() &&
      Verification::coupled(stages_.laws())) {
    // steps of the check lead on where the bodies are those of its tangents
    rounds_left_ = stages_.laws().scales_anywhere() ? most_scalings : 1;
  }
  first_round_ = rounds_left_ > 0;
  if (traces_known) {
    stages_.local(state_.data, state_.traces, residual_);
  } else {
    if (rounds_left_ > 0 && from_zero) {
      stages_.set_accuracy_of_fields(unknown_error);  // solved with all other equations
    }
    evaluate_start();
  }
  newton_.begin(from_zero, structure_.total_unknowns(), options_.max_iterations,
                accelerates() ? options_.newton : 0);
  safeguard_.pause(from_zero && newton_.due_within(steps_from_zero) ? steps_from_zero : 0);
}

/// All columns of a chaos with linear laws at once, instead of the first steps. What it leaves is checked like any
/// iterate, and iterated on if it is not enough.
bool Run::solve_coupled() {
  if (rounds_left_ == 0) {
    return false;
  }
  if (!verification_) {
    verification_.emplace(stages_, known_);
  }
  const bool first = std::exchange(first_round_, false);
  --rounds_left_;
  Matrix step = residual_;
  solved_ = timed(summary_.check_s, [&] {
    return verification_->solve_coupled(state_, coupled_accuracy * options_.rtol, step);
  });
  stages_.set_accuracy_of_fields(accuracy_of_fields());
  if (solved_) {
    state_.data += step;
    history_.clear();
  } else {
    rounds_left_ = 0;
  }
  if (solved_) {
    evaluate_start();
  } else if (first) {
    stages_.evaluate(at());
  }
  return solved_;
}

/// Both stages; what is solved for at once, or was, needs no coarse problem.
void Run::evaluate_start() {
  if ((rounds_left_ == 0 && !solved_) || !stages_.try_evaluate(at())) {
    stages_.evaluate(at());
  }
}

/// Measure the iterate, and tell the caller.
Measured Run::observe() {
  newton_.withdraw();
  if (newton_.due()) {
    propose();
  }
  stop_ = interrupted_ || late();
  Measured measured = stages_.measure(at(), history_, stop_);
  errors_ = estimate(measured);
  double error = error_.largest(errors_);
  if (error <= options_.rtol && !newton_.made() && newton_.failed_before()) {
    propose();  // an accelerated run that was long may hide an error that Newton's step shows
    errors_ = estimate(measured);
    error = error_.largest(errors_);
  }
  summary_.error = error;
  // with a structure that is linearised already a check is the best step from a near parameter set; and of linear laws
  // one that is made for the sets to come is the answer
  const bool first =
      std::exchange(solved_, false) || (summary_.history.empty() && known_ &&
                                        (known_->made() || Verification::exact(stages_.laws())));
  if ((error <= options_.rtol || first) && verifies()) {
    measured = verify(std::move(measured), true);
  }
  report(measured);
  return measured;
}

/// Whether estimates are checked before they are believed.
bool Run::verifies() const {
  return !options_.stop_on_indicator && Verification::possible(stages_.laws());
}

/// Try what is left before giving up: Newton's method, and where that leads nowhere a search from the best iterate.
Measured Run::rescue(Measured measured) {
  if (!verification_) {
    verification_.emplace(stages_, known_);
  }
  if (safeguard_.best_norm() < measured.residual || !std::isfinite(measured.residual)) {
    if (!safeguard_.restore(at())) {
      return measured;
    }
    newton_.withdraw();  // what it proposed is a step from another iterate
    measured = stages_.measure(at(), history_, stop_);
  }
  if (newton_.untried()) {
    propose();
    if (newton_.lost()) {
      return measured;
    }
  }
  const Laws& laws = stages_.laws();
  const bool known = Verification::known(laws);
  const double least = search_until * options_.rtol * measured.residual;
  if (follow(measured)) {
    measured = stages_.measure(at(), history_, stop_);
    if (!known && !laws.scales_anywhere()) {
      propose();  // as of a long history that was marched from the beginning
      errors_ = estimate(measured);
      summary_.error = error_.largest(errors_);
    }
  } else if (known && timed(summary_.check_s, [&] {
               return verification_->search(state_, residual_, least, options_.max_iterations);
             })) {
    state_ = verification_->better();
    residual_ = verification_->better_residual();
    history_.clear();
    error_.restart();
    measured = stages_.measure(at(), history_, stop_);
  }
  for (Index i = 0; known && i < most_checks && !(summary_.error <= options_.rtol); ++i) {
    const double before = summary_.error;
    measured = verify(std::move(measured), false);
    if (i > 0 && !(summary_.error < 0.5 * before)) {
      break;
    }
  }
  return measured;
}

/// What a check finds; nothing where the run is to end before.
std::optional<Verification::Found> Run::checked(const Measured& measured, bool goes_on) {
  return timed(summary_.check_s, [&] {
    return unless_ended([&] {
      return verification_->check(state_, residual_, measured.whole, options_.rtol, goes_on);
    });
  });
}

/// Replace the estimate by what a check finds, and the iterate by a better one where it is not good enough.
/// @param believed the estimate is below the tolerance; else the run is about to give up
Measured Run::verify(Measured measured, bool believed) {
  if (measured.residual == 0.0) {
    return measured;
  }
  if (believed && next_check_ > 0.0 && measured.residual > next_check_) {
    errors_.setConstant(unknown_error);
    summary_.error = unknown_error;
    return measured;
  }
  if (!verification_) {
    verification_.emplace(stages_, known_);
  }
  if (!stages_.exact()) {
    stages_.evaluate(
        at());  // displacements that single precision has added up are not those of the data
    measured = stages_.measure(at(), history_, stop_);
  }
  const bool goes_on = rounds_left_ > 0;
  const auto found = checked(measured, goes_on);
  next_check_ = fall_between_checks * measured.residual;
  // a check moves what hangs on nothing anywhere; what Newton's step says of all that is held counts
  const bool rests =
      believed && newton_.whole() && newton_.hangs_on_nothing() && verification_->at_rounding();
  if (!found) {
    verification_->forget_rounding();  // it was that of a state far from an answer
  }
  const bool good = found && error_.largest(found->errors) <= options_.rtol &&
                    found->imbalance <= Verification::bearable_imbalance * options_.rtol;
  if (good) {
    // where points outnumber nodes the better one may have other forces at the points
    errors_ = found->errors;
    summary_.error = error_.largest(errors_);
  } else if (!found && !rests && believed && (goes_on || !stages_.laws().scales_anywhere())) {
    // tangents of bodies whose stiffness varies are those of the means, and may lead nowhere
    const Matrix& away = verification_->distance();
    errors_ = away.size() > 0 ? larger(errors_, away) : errors_;
    summary_.error = larger(error_.largest(errors_), 2.0 * options_.rtol);
  }
  if (good || rests || !found) {
    return measured;
  }
  rounding_ = found->rounding;
  state_ = verification_->better();
  residual_ = verification_->better_residual();
  errors_ = found->errors_better;
  if (stages_.laws().steps() > 1 && stages_.laws().modes() == 1 &&
      !(found->imbalance_better <= Verification::bearable_imbalance * options_.rtol)) {
    // a step in which a part has flown off is near to itself, whatever its forces are
    errors_ = larger(errors_, found->imbalance_better / Verification::bearable_imbalance);
  }
  summary_.error = error_.largest(errors_);
  history_.clear();
  error_.restart();
  measured = stages_.measure(at(), history_, stop_);
  safeguard_.jumped(iterations(), measured.residual, at());
  next_check_ = fall_between_checks * measured.residual;
  return measured;
}

void Run::report(const Measured& measured) {
  summary_.errors = errors_;
  summary_.indicator = measured.indicator;
  summary_.energy = measured.strain;
  summary_.history.push_back(
      {iterations(), summary_.error, measured.indicator, measured.residual, elapsed()});
  tell(summary_.history.back());
}

void Run::tell(const Iteration& iteration) {
  if (!callback_) {
    return;
  }
  const Timed seconds(summary_.callback_s);
  stages_.attempt([&] {
    try {
      callback_(iteration);
    } catch (const Interrupted&) {
      interrupted_ = true;
    }
  });
}

/// The last iteration, as it goes on.
void Run::tell_again(Index steps) {
  const auto& told = summary_.history;
  Iteration iteration =
      told.empty() ? Iteration{0, unknown_error, unknown_error, unknown_error, 0.0} : told.back();
  iteration.number = iterations() + steps;
  iteration.seconds = elapsed();
  tell(iteration);
}

/// Between Newton's steps, of which a proposal takes many.
bool Run::goes_on(Index steps) {
  if (steps > 0) {
    tell_again(steps);
  }
  stages_.agree();
  return structure_.communicator().everywhere(!interrupted_ && !late());
}

/// As what the run ends here: it was interrupted on some rank, or its time is over.
std::optional<Status> Run::wanted_end() {
  const Communicator& ranks = structure_.communicator();
  if (!stop_ && !(interrupted_ && ranks.alone())) {
    return std::nullopt;
  }
  return ranks.everywhere(!interrupted_) ? Status::time_limit : Status::interrupted;
}

Matrix Run::estimate(const Measured& measured) {
  const auto& sizes = measured.whole.sizes.strain;
  if (measured.residual == 0.0) {
    return Matrix::Zero(sizes.rows(), sizes.cols());
  }
  if (const auto left = newton_.left(measured.residual, measured.data)) {
    return error_.by_step(newton_.step(), *left, measured);
  }
  if (!error_.ready() || safeguard_.plain()) {
    return Matrix::Constant(sizes.rows(), sizes.cols(), unknown_error);
  }
  return error_.by_history(history_, state_, measured);
}

/// One step, to where Newton's method leads or by the history.
void Run::advance(const Measured& measured) {
  if (follow(measured) || solve_coupled()) {
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

/// The steps before that in which something slides away are answers, and what is known of them is said.
/// @return the others: what slides is where weak springs hold it, beside which no error is small
State Run::end_of_march() {
  const Index solved = newton_.columns();
  state_.data += newton_.step().data;
  if (!stages_.try_evaluate(at())) {
    stages_.evaluate(at());
  }
  newton_.withdraw();
  State slid{Matrix::Zero(state_.data.rows(), state_.data.cols()),
             Matrix::Zero(state_.data.rows(), state_.data.cols())};
  const Index others = state_.data.cols() - solved;
  slid.data.rightCols(others).swap(state_.data.rightCols(others));
  slid.traces.rightCols(others).swap(state_.traces.rightCols(others));
  residual_.rightCols(others).setZero();
  Measured measured = stages_.measure(at(), history_, stop_);
  errors_ = Matrix::Constant(errors_.rows(), errors_.cols(), unknown_error);
  const substructure::ColumnGroups groups = stages_.laws().groups();
  for (Index round = 0; solved > 0 && round < most_refined; ++round) {
    propose(solved);
    if (!newton_.made() || newton_.columns() < solved) {
      break;
    }
    const Matrix errors = error_.by_step(newton_.step(), 0.0, measured);
    double largest = 0.0;
    for (Index column = 0; column < solved; ++column) {
      errors_.row(groups.of(column)) = errors.row(groups.of(column));
      largest = larger(largest, errors.row(groups.of(column)).maxCoeff<keep_nan>());
    }
    state_.data += newton_.step().data;
    state_.traces += newton_.step().traces;
    stages_.local(state_.data, state_.traces, residual_);
    residual_.rightCols(others).setZero();
    measured = stages_.measure(at(), history_, stop_);
    if (structure_.communicator().largest(largest) <= options_.rtol) {
      break;
    }
  }
  summary_.error = unknown_error;
  report(measured);
  return slid;
}

void Run::propose() { propose(state_.data.cols()); }

/// Work that may take long, and is given up where the run is to end: then it has made nothing.
/// @return the answer of `work`, or nothing
template <class Work>
auto Run::unless_ended(const Work& work) -> decltype(work()) {
  if (!structure_.communicator().alone()) {
    return work();
  }
  Interruptible ending([this] {
    tell_again(0);
    return interrupted_ || late();
  });
  try {
    return work();
  } catch (const Interrupted&) {
    ending.pass_on();
    return {};
  }
}

void Run::propose(Index most) {
  const NewtonOutcome outcome = timed(
      summary_.newton_s, [&] { return unless_ended([&] { return newton_.propose(at(), most); }); });
  summary_.newton_s -= outcome.flexibility_s;
  summary_.flexibility_s += outcome.flexibility_s;
  newton_stages_ += static_cast<Index>(std::ceil(outcome.stages));
  summary_.newton_steps += outcome.steps;
  if (outcome.falls.size() > 0) {  // an answer that is found again has no way
    summary_.falls.conservativeResizeLike(Vector::Zero(outcome.falls.size()));
    summary_.falls = summary_.falls.cwiseMax(outcome.falls);
  }
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

/// An answer with a number that is none is no answer, whatever was estimated. Collective.
void Run::refuse_none() {
  if (!structure_.communicator().everywhere(state_.data.allFinite() && state_.traces.allFinite() &&
                                            std::isfinite(summary_.energy))) {
    summary_.status = Status::undecided;
    summary_.error = unknown_error;
  }
}

void Run::finish(Status status) {
  stages_.agree();
  if (!stages_.exact()) {
    stages_.refresh(state_);
  }
  structure_.seen_forces().keep(state_.data, state_.traces);
  // what the bodies' factors leave is no part of the iteration, but of the error
  const double bearable = bearable_rounding * options_.rtol;
  const bool was_small = error_.largest(summary_.errors) <= bearable;
  summary_.errors =
      stages_.with_rounding_of_bodies(summary_.errors, state_, accuracy_of_fields(), options_.rtol);
  if (!stages_.laws().linear_everywhere() && !options_.stop_on_indicator) {
    // steps that end far below the tolerance do not say how far
    summary_.errors = larger(summary_.errors, Verification::resolution(options_.rtol));
  }
  summary_.error = larger(summary_.error, error_.largest(summary_.errors));
  const bool is_rounding = was_small && summary_.error > bearable;
  summary_.status = status == Status::converged && is_rounding ? Status::inexact : status;
  refuse_none();
  summary_.iterations = iterations();
  summary_.restarts = safeguard_.restarts();
  summary_.global_s = stages_.global_seconds();
  summary_.local_s = stages_.local_seconds();
  summary_.other_s = elapsed() - summary_.callback_s - summary_.global_s - summary_.local_s -
                     summary_.newton_s - summary_.flexibility_s - summary_.check_s;
}

double Run::elapsed() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }

}  // namespace latin::iteration
