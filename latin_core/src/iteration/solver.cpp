#include "latin/iteration/solver.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <exception>
#include <limits>
#include <memory>
#include <utility>

#include "latin/common/error.hpp"
#include "latin/iteration/newton.hpp"

namespace latin::iteration {
namespace {

using Clock = std::chrono::steady_clock;

double since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

void check_options(const Options& options) {
  const auto demand = [](bool holds, const std::string& text) {
    if (!holds) {
      throw InputError(text);
    }
  };
  demand(options.rtol > 0.0 && options.rtol < 1.0,
         "rtol is " + std::to_string(options.rtol) + ": it must lie in (0, 1)");
  demand(options.max_iterations >= 1,
         "max_iterations is " + std::to_string(options.max_iterations) + ": it must be at least 1");
  demand(options.acceleration >= 0 && options.acceleration <= 100,
         "acceleration is " + std::to_string(options.acceleration) + ": it must lie in 0..100");
  demand(options.relaxation > 0.0 && options.relaxation <= 1.0,
         "relaxation is " + std::to_string(options.relaxation) + ": it must lie in (0, 1]");
}

/// Depth of the history that only observes, where nothing is accelerated.
constexpr Index observing_depth = 10;
/// Progress is a residual or an error that fell to this share of what it was when progress was last seen.
constexpr double progress = 0.9;
constexpr Index longest_pause = 64;
/// Accelerated steps so much longer than the residual are not taken.
constexpr double longest_step = 1e7;
/// Accelerated iterations without a better residual before the safeguard steps in.
constexpr Index patience = 15;
/// Relaxation of the safeguard's plain steps: an averaged step converges for every monotone law.
constexpr double averaged = 0.8;
/// An accelerated residual this much above the best one so far is not followed any further.
constexpr double growth_before_restart = 10.0;

/// Averaged steps from zero before Newton's method is tried: they find most of what is open and closed.
constexpr Index steps_before_newton = 2;
/// From elsewhere (another parameter set) a few accelerated steps are often enough, and cheaper than dense
/// factorisations: so many more for each of the unknowns.
constexpr double steps_per_unknown = 0.05;
/// Accelerated steps after Newton's method failed; twice as many after the next time.
constexpr Index steps_after_failure = 8;
/// Accuracy of Newton's method, as a share of that of the run.
constexpr double newton_accuracy = 1e-3;
/// A Newton step that leaves less than this of the residual is the error of the iterate before it.
constexpr double believable = 0.5;
/// The residual falls by so much more than the error in a Newton step (measured: 0.1 to 6).
constexpr double residual_over_error = 2.0;
/// A step so much larger than the data is a body that flies off.
constexpr double absurd = 1e6;
/// Below this share of the data the residual need not fall.
constexpr double settled = 1e-10;

/// One solve: the local and the global stage in turn.
class Run {
 public:
  Run(const substructure::Laws& laws, const Options& options, const Matrix& amplitudes,
      State& state, std::size_t snapshots, const Callback& callback)
      : structure_(laws.structure()),
        global_(laws),
        local_(laws, amplitudes.cols()),
        options_(options),
        amplitudes_(amplitudes),
        state_(state),
        callback_(callback),
        history_(laws, amplitudes.cols(),
                 (options.acceleration > 0 ? options.acceleration : observing_depth) +
                     static_cast<Index>(snapshots)),
        hindsight_(structure_, amplitudes.cols()),
        residual_(Matrix::Zero(structure_.rows(), amplitudes.cols())),
        step_(structure_.rows(), amplitudes.cols()),
        step_residual_(structure_.rows(), amplitudes.cols()),
        newton_helps_(options.acceleration > 0 && options.newton > 0 &&
                      substructure::InterfaceSystem::suits(laws, options.newton)),
        may_fly_(structure_.communicator().maximum(laws.linear() ? 0 : 1) > 0),
        start_(Clock::now()) {}

  /// Start from the combination of snapshots with the smallest residual. It costs local stages only,
  /// because the global image of a state does not depend on the laws.
  void combine(const std::vector<const State*>& snapshots) {
    const auto start = Clock::now();
    state_ = *snapshots.front();
    local();
    Matrix other = Matrix::Zero(structure_.rows(), amplitudes_.cols());
    for (std::size_t i = 1; i < snapshots.size(); ++i) {
      attempt([&] { local_.apply(snapshots[i]->data, snapshots[i]->traces, other); });
      history_.push(snapshots[i]->data - state_.data, other - residual_,
                    snapshots[i]->traces - state_.traces);
    }
    history_.fit(residual_);
    const State& away = history_.predicted_error();
    state_.data -= away.data;
    state_.traces -= away.traces;
    rounded_ =
        true;  // the caller says that the traces are those of the data: what is accepted shows it
    summary_.other_s += since(start);
  }

  Summary run(bool traces_known) {
    if (structure_.total_rows() == 0) {
      summary_.status = Status::converged;
      summary_.energy = global_.size(state_.data, state_.traces, amplitudes_).strain;
      return summary_;
    }
    if (!traces_known) {
      global();
    }
    local();
    if (newton_helps_ && state_.data.isZero(0.0)) {
      pause_ = steps_before_newton;
    } else {
      newton_wait_ += static_cast<Index>(steps_per_unknown *
                                         static_cast<double>(structure_.interface_unknowns()));
    }
    double first_norm = -1.0;
    double norm_then = std::numeric_limits<double>::infinity();
    double error_then = std::numeric_limits<double>::infinity();
    Index last_progress = 0;
    for (;;) {
      proposed_ = false;
      if (newton_wait_ == 0) {
        propose();
      }
      const auto measuring = Clock::now();
      const Measure measured = measure();
      const double norm = history_.residual_norm();
      const substructure::Size& size = measured.size;
      summary_.indicator = measured.indicator;
      double error = estimate(norm, measured);
      if (error <= options_.rtol && !proposed_ && failures_ > 0) {
        propose();  // an accelerated run that was long may hide an error that Newton's step shows
        error = estimate(norm, measured);
      }
      summary_.error = error;
      summary_.energy = size.strain;
      const Iteration record{summary_.iterations, error, summary_.indicator, norm, since(start_)};
      summary_.history.push_back(record);
      summary_.other_s += since(measuring);
      if (callback_) {
        attempt([&] {
          try {
            callback_(record);
          } catch (const Interrupted&) {
            interrupted_ = true;
          }
        });
      }
      if (first_norm < 0.0) {
        first_norm = norm;
      }
      if (!std::isfinite(norm) || norm > 1e10 * first_norm) {
        summary_.status = Status::diverged;
        break;
      }
      if ((options_.stop_on_indicator ? summary_.indicator : error) <= options_.rtol) {
        if (rounded_ && summary_.iterations < options_.max_iterations) {
          global();
          local();
          // what was small before was so in single precision, or in a start, only
          first_norm = first_norm > 0.0 ? first_norm : -1.0;
          best_norm_ = norm_then = error_then = std::numeric_limits<double>::infinity();
          continue;
        }
        summary_.status = Status::converged;
        if (proposed_ && proposed_columns_ == step_.cols()) {
          // the estimate was of the iterate before; errors fall less than residuals do
          if (follow(norm)) {
            summary_.error *= std::min(residual_over_error * best_norm_ / norm, 1.0);
          }
        }
        break;
      }
      if (stop_ || (interrupted_ && structure_.communicator().alone())) {
        summary_.status = Status::interrupted;
        break;
      }
      if (summary_.iterations >= options_.max_iterations) {
        summary_.status = Status::max_iterations;
        break;
      }
      if (norm < progress * norm_then || error < progress * error_then) {
        last_progress = summary_.iterations;
        norm_then = std::min(norm, norm_then);
        error_then = std::min(error, error_then);
      } else if (summary_.iterations - last_progress > options_.stagnation_window) {
        summary_.status = Status::stagnated;
        break;
      }
      advance(norm, measured.data_norm);
    }
    structure_.communicator().agree(failure_);
    if (rounded_) {
      global_.apply(state_.data, amplitudes_, state_.traces);
    }
    return summary_;
  }

 private:
  /// Steps of its own that a run needs before its error estimate is believed. Slow parts of an error hide
  /// behind fast ones at first, and snapshots share the errors that were left in all of them; an
  /// accelerated run separates them in one step, a plain one needs its whole history.
  [[nodiscard]] Index own_before_estimate() const {
    return options_.acceleration > 0 ? 1 : observing_depth;
  }

  /// Do what may fail on one rank and not on others. They wait for this one until the next reduction, where
  /// all learn of it.
  template <typename Work>
  void attempt(Work&& work) {
    try {
      std::forward<Work>(work)();
    } catch (...) {
      if (structure_.communicator().alone()) {
        throw;
      }
      failure_ = failure_ ? failure_ : std::current_exception();
    }
  }

  /// What the ranks add up of one iterate.
  struct Measure {
    substructure::Size size;
    double indicator;
    double data_norm;
    std::array<double, 2 * Hindsight::most> distances;
  };

  /// Fit the history to the present residual; all numbers that decide anything go through this one reduction
  /// and that of the error estimate.
  Measure measure() {
    const substructure::Size size = global_.share_of_size(state_.data, state_.traces, amplitudes_);
    const auto [distance, extent] = stage_shares(structure_, state_, residual_);
    Measure measured{};
    std::array<double, 8 + 2 * Hindsight::most> sums{size.strain,
                                                     size.trace,
                                                     size.work,
                                                     distance,
                                                     extent,
                                                     history_.share_of_square(state_.data),
                                                     failure_ ? 1.0 : 0.0,
                                                     interrupted_ ? 1.0 : 0.0};
    std::ranges::copy(hindsight_.shares(state_), sums.begin() + 8);
    history_.fit(residual_, sums);
    if (sums[6] > 0.0) {
      structure_.communicator().agree(failure_);
    }
    stop_ = sums[7] > 0.0;
    measured.size = substructure::Size{sums[0], sums[1], sums[2]}.positive();
    measured.indicator = stage_distance({sums[3], sums[4]});
    measured.data_norm = std::sqrt(sums[5]);
    std::copy(sums.begin() + 8, sums.end(), measured.distances.begin());
    return measured;
  }

  /// |r|. Collective.
  [[nodiscard]] double norm_of(const Matrix& residual) const {
    return std::sqrt(structure_.communicator().sum(history_.share_of_square(residual)));
  }

  [[nodiscard]] double estimate(double norm, const Measure& measured) {
    if (norm == 0.0) {
      return 0.0;
    }
    const double least = summary_.indicator * least_of_indicator;
    if (proposed_ && proposed_columns_ == step_.cols() &&
        norm_of(step_) < absurd * (norm + norm_of(state_.data))) {
      // the step is the error as far as the linearisation holds: the residual that it leaves says so
      const double after = norm_of(step_residual_);
      const double left = after > settled * measured.data_norm ? after / norm : 0.0;
      if (left < believable) {
        const substructure::Size error =
            substructure::difference_size(structure_, step_, step_traces_);
        return std::max(error.relative_to(measured.size) / (1.0 - left), least);
      }
    }
    if (own_ < own_before_estimate() || pause_ > 0) {
      return std::numeric_limits<double>::infinity();
    }
    const double own =
        std::max(history_.error(measured.size, rounding_share * measured.data_norm), least);
    const double raised = hindsight_.raised(own, norm, measured.size, measured.distances);
    hindsight_.keep(state_, own, norm);
    return raised;
  }

  /// Where Newton's method leads from here. What it changes is the estimate of the error, too.
  void propose() {
    if (!newton_helps_ || !residual_.allFinite() || residual_.isZero(0.0)) {
      return;
    }
    const auto start = Clock::now();
    State proposal = state_;
    try {
      if (!newton_) {
        newton_ = std::make_unique<Newton>(global_, local_, amplitudes_);
      }
      const Newton::Outcome outcome =
          newton_->solve(proposal.data, proposal.traces, newton_accuracy * options_.rtol);
      proposed_columns_ = outcome.solved;
      summary_.iterations += static_cast<Index>(std::ceil(outcome.stages));
      summary_.newton_steps += outcome.steps;
    } catch (const NumericalError&) {
      newton_helps_ =
          false;  // a body without a usable flexibility: the accelerated iteration goes on alone
      return;
    }
    proposed_ = true;
    step_ = proposal.data - state_.data;
    step_traces_ = proposal.traces - state_.traces;
    step_residual_.resize(step_.rows(), step_.cols());
    local_.apply(proposal.data, proposal.traces, step_residual_);
    summary_.newton_s += since(start);
  }

  /// Go where Newton's method leads, if it solved all columns or more than the last time. If not, the accelerated
  /// iteration goes on as if nothing had been tried, for a longer while each time.
  bool follow(double norm) {
    const double now = norm_of(step_residual_);
    const bool all = proposed_columns_ == step_.cols();
    const bool sane = norm_of(step_) < absurd * (norm + norm_of(state_.data));
    const bool good = sane && (all ? now < norm : proposed_columns_ > solved_columns_);
    if (!all || !good) {
      ++failures_;
      newton_wait_ = wait_;
      wait_ *= 2;
    }
    if (!good) {
      return false;
    }
    solved_columns_ = proposed_columns_;
    state_.data += step_;
    state_.traces += step_traces_;
    rounded_ = rounded_ && !all;
    residual_.swap(step_residual_);
    history_.clear();
    own_ = 0;
    pause_ = 0;
    best_norm_ = std::numeric_limits<double>::infinity();
    remember(now);
    return true;
  }

  void remember(double norm) {
    if (norm < best_norm_) {
      best_at_ = summary_.iterations;
      best_norm_ = norm;
      best_ = state_;
      best_residual_ = residual_;
      trapped_ = false;
    }
  }

  /// Traces of the data; `step`: of what was added to it, in single precision.
  void global(const Matrix* step = nullptr) {
    const auto start = Clock::now();
    attempt([&] {
      if (step != nullptr) {
        global_.change(*step, state_.traces);
      } else {
        global_.apply(state_.data, amplitudes_, state_.traces);
      }
      if (structure_.macro_size() > 0) {
        added_ = global_.balance(local_, state_.data, state_.traces);
      }
    });
    rounded_ = step != nullptr;
    summary_.global_s += since(start);
    ++summary_.iterations;
  }

  void local() {
    const auto start = Clock::now();
    attempt([&] { local_.apply(state_.data, state_.traces, residual_); });
    summary_.local_s += since(start);
  }

  /// One step, plain or accelerated, and both stages at its end.
  void advance(double norm, double data_norm) {
    if (proposed_ && follow(norm)) {
      return;
    }
    newton_wait_ = std::max<Index>(newton_wait_ - 1, 0);
    const auto start = Clock::now();
    bool accelerate = options_.acceleration > 0;
    if (accelerate) {
      guard(norm, data_norm);
      accelerate = pause_ == 0;
      pause_ = std::max<Index>(pause_ - 1, 0);
    }
    if (accelerate) {
      history_.step(residual_, options_.relaxation, step_);
      if (may_fly_ && norm_of(step_) > longest_step * norm) {
        // nothing answers yet (a body flies through a gap): the history says nothing
        history_.clear();
        step_ = std::min(options_.relaxation, averaged) * residual_;
      }
    } else if (options_.acceleration > 0) {
      step_ = std::min(options_.relaxation, averaged) * residual_;
    } else {
      step_ = residual_;
      global_.laws().precondition(step_);
      step_ *= options_.relaxation;
    }
    residual_change_ = residual_;
    traces_change_ = state_.traces;
    state_.data += step_;
    summary_.other_s += since(start);
    global(options_.single_precision ? &step_ : nullptr);
    local();
    const auto pushing = Clock::now();
    if (structure_.macro_size() > 0) {
      step_ += added_;
    }
    residual_change_ = residual_ - residual_change_;
    traces_change_ = state_.traces - traces_change_;
    history_.push(step_, residual_change_, traces_change_);
    ++own_;
    summary_.other_s += since(pushing);
  }

  /// An accelerated step may lead astray, or in circles, where a law changes its branch (contact opens,
  /// friction slips). Then the best iterate is taken up again, the history dropped, and some plain steps lead
  /// on, more each time.
  /// If they only lead back here, that iterate is a trap (friction is not monotone): go on from where we are.
  void guard(double norm, double data_norm) {
    const bool led_astray = norm > growth_before_restart * best_norm_;
    const bool at_rest = norm <= rounding_share * data_norm;
    const bool circling = summary_.iterations - best_at_ > patience && pause_ == 0;
    if ((led_astray || circling) && !at_rest) {
      best_at_ = summary_.iterations;
      if (trapped_) {
        best_norm_ = norm;
        best_ = state_;
        best_residual_ = residual_;
      } else {
        state_ = best_;
        residual_ = best_residual_;
      }
      trapped_ = !trapped_;
      history_.clear();
      history_.fit(residual_);
      pause_ = plain_steps_;
      plain_steps_ = std::min<Index>(2 * plain_steps_, longest_pause);
      ++summary_.restarts;
    } else {
      remember(norm);
    }
  }

  const substructure::Structure& structure_;
  substructure::GlobalStage global_;
  substructure::LocalStage local_;
  const Options& options_;
  const Matrix& amplitudes_;
  State& state_;
  const Callback& callback_;
  History history_;
  Hindsight hindsight_;
  Matrix residual_;
  Matrix step_;
  Matrix added_;            ///< to the data, by the coarse problem
  Matrix step_traces_;      ///< global image of a proposed step
  Matrix step_residual_;    ///< residual after it
  Matrix residual_change_;  ///< over the last step
  Matrix traces_change_;
  std::unique_ptr<Newton> newton_;
  bool newton_helps_;           ///< Newton steps are possible
  bool may_fly_;                ///< some law is not linear, so that a body may lose touch
  bool rounded_ = false;        ///< the traces hold single-precision changes, or those of a start
  bool proposed_ = false;       ///< `step_` is Newton's
  Index proposed_columns_ = 0;  ///< that Newton's step has solved
  Index solved_columns_ = 0;    ///< that Newton's method has solved before
  Index newton_wait_ = steps_before_newton;  ///< iterations until Newton's method is tried again
  Index wait_ = steps_after_failure;         ///< after the next failure
  Index failures_ = 0;
  Summary summary_;
  State best_;  ///< iterate with the smallest residual, for the safeguard
  Matrix best_residual_;
  double best_norm_ = std::numeric_limits<double>::infinity();
  Index best_at_ = 0;      ///< iteration of the best iterate
  bool trapped_ = false;   ///< no better iterate was found since the last return to the best one
  Index pause_ = 0;        ///< plain steps still to be taken
  Index plain_steps_ = 4;  ///< after the next restart
  Index own_ = 0;          ///< differences in the history that are this run's
  Clock::time_point start_;
  bool interrupted_ = false;    ///< on this rank
  bool stop_ = false;           ///< interrupted on some rank, as all know
  std::exception_ptr failure_;  ///< of this rank, until the ranks agree on it
};

}  // namespace

std::string to_string(Status status) {
  switch (status) {
    case Status::converged:
      return "converged";
    case Status::max_iterations:
      return "max_iterations";
    case Status::stagnated:
      return "stagnated";
    case Status::diverged:
      return "diverged";
    case Status::interrupted:
      return "interrupted";
  }
  return "unknown";
}

Summary solve(const substructure::Laws& laws, const Options& options, const Matrix& amplitudes,
              State& state, const std::vector<const State*>& snapshots, const Callback& callback) {
  const substructure::Structure& structure = laws.structure();
  const Index columns = amplitudes.cols();
  const auto fit = [&structure, columns](const State& each) {
    if (each.data.rows() != structure.rows() || each.data.cols() != columns ||
        each.traces.rows() != structure.rows() || each.traces.cols() != columns) {
      throw InputError("a start state has shape (" + std::to_string(each.data.rows()) + ", " +
                       std::to_string(each.data.cols()) + "), this problem needs (" +
                       std::to_string(structure.rows()) + ", " + std::to_string(columns) + ")");
    }
  };
  const bool from_zero = state.data.size() == 0;
  const Index most = structure.communicator().maximum(columns);
  structure.communicator().together([&] {
    check_options(options);
    if (amplitudes.rows() != structure.loads()) {
      throw InputError("amplitudes of " + std::to_string(amplitudes.rows()) +
                       " load patterns, this problem has " + std::to_string(structure.loads()));
    }
    if (columns != most) {
      throw InputError(std::to_string(columns) + " columns on this rank, " + std::to_string(most) +
                       " on another");
    }
    laws.check_columns(columns);
    for (const State* snapshot : snapshots) {
      fit(*snapshot);
    }
    if (snapshots.empty() && !from_zero) {
      fit(state);
    }
  });
  Run run(laws, options, amplitudes, state, snapshots.size(), callback);
  if (!snapshots.empty()) {
    run.combine(snapshots);
    return run.run(true);
  }
  if (from_zero) {
    state.data = Matrix::Zero(structure.rows(), columns);
    state.traces = Matrix::Zero(structure.rows(), columns);
  }
  return run.run(false);
}

}  // namespace latin::iteration
