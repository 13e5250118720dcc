#include "iteration/sweep.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <numeric>
#include <span>
#include <string>

#include "common/numbers.hpp"
#include "common/threads.hpp"
#include "iteration/batch.hpp"
#include "iteration/verification.hpp"
#include "latin/common/error.hpp"

namespace latin::iteration {
namespace {

/// All swept values, one column a point, every one scaled by its range.
Matrix coordinates(const std::vector<SweptParameter>& parameters) {
  Index rows = 0;
  for (const SweptParameter& each : parameters) {
    rows += each.values.rows();
  }
  Matrix all(rows, parameters.empty() ? 1 : parameters.front().values.cols());
  rows = 0;
  for (const SweptParameter& each : parameters) {
    if (each.values.cols() != all.cols() || each.pattern.cols() != each.values.rows()) {
      throw InputError("sweep: parameter '" + each.parameter + "' of interface '" + each.interface +
                       "' has a pattern of " + std::to_string(each.pattern.cols()) +
                       " columns, values of shape (" + std::to_string(each.values.rows()) + ", " +
                       std::to_string(each.values.cols()) + ") and " + std::to_string(all.cols()) +
                       " points");
    }
    if (each.columns < 1 || each.pattern.rows() % each.columns != 0) {
      throw InputError("sweep: parameter '" + each.parameter + "' of interface '" + each.interface +
                       "' has a pattern of " + std::to_string(each.pattern.rows()) + " rows for " +
                       std::to_string(each.columns) + " columns");
    }
    for (Index i = 0; i < each.values.rows(); ++i) {
      const double range = each.values.row(i).maxCoeff() - each.values.row(i).minCoeff();
      all.row(rows++) = (range > 0.0 ? 1.0 / range : 0.0) * each.values.row(i);
    }
  }
  return all;
}

/// What the residuals of points that are tried together may take.
constexpr double together_bytes = 64e6;
/// Snapshots are left out while the error stays below this share of the tolerance.
constexpr double spare_accuracy = 0.3;
constexpr Index fewest_snapshots = 4;
/// Points in a row that the first iterate answered, before several are tried together.
constexpr Index streak_before_batch = 3;
/// Of linear laws, so many times as many together; not for fewer points than these.
constexpr Index many_together = 8;
constexpr Index least_directly = 3;
/// Points that are far from each other, whose states the others start from.
constexpr Index most_far = 8;

/// Tolerance, relative to the one asked for, of the first samples: nothing is known of their scatter.
constexpr double of_first_samples = 1e-3;
constexpr double tolerance_of_first_samples = 1e-8;
/// Scatter below so many times the errors of the samples is not told from these.
constexpr double above_errors = 2.0;
/// But one above this is not let go: that nothing is known of it is said.
constexpr double most_hidden = 1e-6;
/// Errors of samples, relative to the tolerance of their scatter, that leave it right.
constexpr double enough_for_scatter = 3.0;
constexpr Index first_samples = 4;
/// Scatter below this, relative to the samples, is none.
constexpr double least_scatter = 3e-7;
/// Tolerances below this are rounding.
constexpr double least_tolerance = 1e-12;

/// A strain energy below this fraction of the work of the interface forces is that of a rigid motion.
constexpr double strain_free = 1e-14;
/// Data so many times as large as the smallest of a point are those of something that has flown: half of their digits.
constexpr double farthest_start = 1e8;

/// How much the displacements and strains of the bodies scatter between samples.
class Scatter {
 public:
  explicit Scatter(const substructure::Structure& structure) : structure_(structure) {}

  /// @param errors of the bodies, relative
  /// @param sizes  of a state, asked for of the first
  void add(const State& state, const Vector& errors,
           const std::function<substructure::Sizes(const State&)>& sizes) {
    ++count_;
    errors_ = count_ == 1 ? errors : larger(errors_, errors);
    if (count_ == 1) {
      mean_ = Matrix::Zero(state.traces.rows(), state.traces.cols());
      squares_ = mean_forces_ = works_ = mean_;
      size_ = sizes(state);
    }
    const Matrix forces = state.data - structure_.directions().asDiagonal() * state.traces;
    const Matrix away = state.traces - mean_;
    const auto count = static_cast<double>(count_);
    mean_ += away / count;
    mean_forces_ += (forces - mean_forces_) / count;
    squares_ += away.cwiseProduct(state.traces - mean_);
    works_ += away.cwiseProduct(forces - mean_forces_);
  }
  [[nodiscard]] Index count() const { return count_; }
  /// The least of a body that scatters at all, on any rank, relative to the size of its mean; at most 1. Collective.
  [[nodiscard]] double least() const {
    const Vector scatters = of_bodies();
    return -structure_.communicator().largest(scatters.size() > 0 ? -scatters.minCoeff() : -1.0);
  }
  /// The largest of errors of bodies, relative to what each of them scatters by. Collective.
  [[nodiscard]] double relative(const Vector& errors) const {
    const Vector relative = errors.cwiseQuotient(of_bodies());
    return structure_.communicator().largest(relative.size() > 0 ? relative.maxCoeff<keep_nan>()
                                                                 : 0.0);
  }
  /// Of all bodies and ranks, the largest errors so far over their largest relative to the scatter. Collective.
  [[nodiscard]] double of_largest_error() const {
    const double relative_error = relative(errors_);
    const double error =
        structure_.communicator().largest(errors_.size() > 0 ? errors_.maxCoeff<keep_nan>() : 0.0);
    return relative_error > 0.0 && std::isfinite(relative_error) ? error / relative_error : least();
  }

 private:
  /// Of each body, in displacement or strain, relative to its mean.
  [[nodiscard]] Vector of_bodies() const {
    Vector scatters = Vector::Ones(static_cast<Index>(structure_.bodies().size()));
    const auto count = static_cast<double>(count_);
    for (std::size_t b = 0; b < structure_.bodies().size(); ++b) {
      const auto at = static_cast<Index>(b);
      const auto rows = Eigen::seqN(structure_.body_rows()[b], structure_.bodies()[b].rows());
      const Vector metric = structure_.trace_metric()(rows);
      const Vector weights = structure_.weights()(rows);
      // what is only the errors of the samples is no scatter
      const auto consider = [&](double variance, double size) {
        const double scatter = size > 0.0 ? std::sqrt(variance / size) : 1.0;
        const double hidden = std::min(above_errors * errors_(at), most_hidden);
        if (scatter > std::max(hidden, least_scatter)) {
          scatters(at) = std::min(scatters(at), scatter);
        }
      };
      for (Index column = 0; column < mean_.cols(); ++column) {
        consider(squares_.col(column)(rows).cwiseAbs().dot(metric) / count,
                 mean_.col(column)(rows).cwiseAbs2().dot(metric));
        // loads do not scatter: what the forces of the interfaces do is the strain energy
        const double strain = size_.strain(column, at);
        if (strain > strain_free * size_.work(column, at)) {
          consider(std::abs(works_.col(column)(rows).dot(weights)) / count, strain);
        }
      }
    }
    return scatters;
  }

  const substructure::Structure& structure_;
  Index count_ = 0;
  Vector errors_;             ///< the largest of every body so far
  substructure::Sizes size_;  ///< of the first
  Matrix mean_;
  Matrix mean_forces_;
  Matrix squares_;
  Matrix works_;
};

class Sweep {
 public:
  Sweep(const substructure::Laws& laws, const Options& options, const Matrix& amplitudes,
        const std::vector<SweptParameter>& parameters, std::vector<State> known,
        std::vector<Index> known_points, const Callback& callback,
        const PointCallback& point_callback, Beginning* beginning)
      : laws_(laws),
        structure_(laws.structure()),
        options_(options),
        scatter_(laws.structure()),
        wanted_(options.rtol),
        amplitudes_(amplitudes),
        parameters_(parameters),
        known_(std::move(known)),
        known_points_(std::move(known_points)),
        callback_(noting(callback)),
        point_callback_(point_callback),
        where_(coordinates(parameters)) {
    // of the interfaces of other ranks only the values count: they say which points are near
    bool varies = false;
    for (const SweptParameter& each : parameters) {
      if (each.interface.empty()) {
        check_load(each);
        loads_vary_ = true;
        continue;
      }
      if (each.parameter == stiffness_parameter) {
        check_stiffness(each);
        const bool here = std::ranges::any_of(structure_.members(), [&each](const auto& body) {
          return std::ranges::find(body, each.interface) != body.end();
        });
        const bool somewhere = structure_.communicator().maximum(here ? 1 : 0) > 0;
        if (here || !somewhere) {
          stiffness_.push_back(&each);
        }
        varies = true;
        continue;
      }
      const bool here = structure_.has_interface(each.interface);
      const bool somewhere = structure_.communicator().maximum(here ? 1 : 0) > 0;
      if (here || !somewhere) {  // setting a parameter of none names it
        own_parameters_.push_back(&each);
      }
    }
    scales_ = laws_.scales_anywhere() || varies;
    const Communicator& ranks = structure_.communicator();
    const double bytes = 8.0 *
                         static_cast<double>(ranks.maximum(structure_.rows()) * amplitudes.cols()) *
                         static_cast<double>(options.snapshots + 6);
    most_together_ = std::min(options.together, static_cast<Index>(together_bytes / (bytes + 1.0)));
    if (options.snapshots < 2 || options.acceleration < 1 || structure_.total_rows() == 0 ||
        !ranks.everywhere(!laws.transformed()) || loads_vary_ || scales_) {
      most_together_ = 1;
    }
    most_together_ = std::max<Index>(most_together_, 1);
    if (!options.stop_on_indicator && !scales_ && Verification::possible(laws)) {
      linear_ = std::make_shared<Linearisation>();
      together_from_ = std::min(together_from_, fewest_snapshots);
    }
    direct_ = ranks.alone() && linear_ && most_together_ > 1 && Verification::exact(laws);
    if (direct_) {
      most_together_ = std::clamp(static_cast<Index>(together_bytes / (bytes + 1.0)),
                                  most_together_, many_together * most_together_);
      const auto rows = static_cast<double>(structure_.rows());
      if (beginning != nullptr && 3.0 * 8.0 * rows * rows <= Beginning::most_bytes) {
        beginning_ = beginning;
      }
    }
  }

  /// @throws InputError if positions or states do not fit; on every rank alike
  void check(const std::vector<Index>& order) const {
    const auto check_position = [this](Index point, const std::string& what) {
      if (point < 0 || point >= where_.cols()) {
        throw InputError("sweep: " + what + " " + std::to_string(point) + " is none of " +
                         std::to_string(where_.cols()) + " points (0 to " +
                         std::to_string(where_.cols() - 1) + ")");
      }
    };
    for (const Index point : order) {
      check_position(point, "point");
    }
    for (const Index point : known_points_) {
      check_position(point, "position of a known state");
    }
    for (const State& state : known_) {
      for (const Matrix* block : {&state.data, &state.traces}) {
        if (block->rows() != structure_.rows() || block->cols() != amplitudes_.cols()) {
          throw InputError("sweep: a known state of shape (" + std::to_string(block->rows()) +
                           ", " + std::to_string(block->cols()) + "), expected (" +
                           std::to_string(structure_.rows()) + ", " +
                           std::to_string(amplitudes_.cols()) + ")");
        }
      }
    }
  }

  /// @return converged if it went through, else as what it has ended
  Status run(const std::vector<Index>& order, const NextPoints& next) {
    for (std::size_t i = 0; i < known_.size(); ++i) {
      shift(known_[i].traces, known_points_[i], -1.0);
    }
    try {
      walk(order);
      release_early();
      if (next) {
        run_shares(next);
      }
    } catch (const Interrupted&) {
      hand_out_early();  // all other finished points have been handed out
      return ended_;
    }
    return Status::converged;
  }

 private:
  /// Points that start from what is known now, as often as there are more.
  void run_shares(const NextPoints& next) {
    scatter_known_ = scatter_.count() >= first_samples;
    const std::size_t count = known_.size();
    const Linearisation linear = linear_ ? *linear_ : Linearisation();
    const Matrix basis = basis_;
    const Index together_from = together_from_;
    const Index streak = streak_;
    for (std::vector<Index> points = next(); !points.empty(); points = next()) {
      check(points);
      known_.resize(count);
      known_points_.resize(count);
      if (linear_) {
        *linear_ = linear;
      }
      basis_ = basis;
      together_from_ = together_from;
      streak_ = streak;
      walk(points);
      release_early();
    }
  }

  /// Whether samples are held to their scatter.
  [[nodiscard]] bool follows_scatter() const {
    return options_.scatter && structure_.total_rows() > 0 && !options_.stop_on_indicator;
  }

  /// The tolerance of the next samples.
  void set_tolerance() {
    if (!follows_scatter()) {
      return;
    }
    const double tolerance = scatter_.count() < first_samples
                                 ? std::min(of_first_samples * wanted_, tolerance_of_first_samples)
                                 : 0.5 * scatter_.least() * wanted_;
    options_.rtol = std::max(tolerance, std::min(wanted_, least_tolerance));
  }

  void walk(const std::vector<Index>& order) {
    if (direct_) {
      begin();
    }
    if (direct_ && static_cast<Index>(order.size()) > least_directly) {
      return solve_directly(order);
    }
    for (std::size_t next = 0; next < order.size();) {
      set_tolerance();
      const auto left = static_cast<Index>(order.size() - next);
      const Index together =
          streak_ < streak_before_batch ? 1 : std::min({left, most_together_, 2 * (streak_ - 1)});
      const std::span<const Index> points(order.data() + next, static_cast<std::size_t>(together));
      if (together > 1) {
        try_together(points);
      } else {
        solve_alone(points.front());
      }
      next += points.size();
      if (scatter_.count() >= first_samples) {
        release_early();
      }
    }
  }

  /// Take the tangents of the laws themselves.
  void begin() {
    if (beginning_ == nullptr || linear_->made()) {
      return;
    }
    taken_ = beginning_->take();
    if (!taken_.owns_lock()) {  // the same once more: answers must not depend on who was first
      own_ = std::make_unique<Beginning>();
      beginning_ = own_.get();
    }
    *linear_ = beginning_->of(laws_, amplitudes_);
  }

  /// Points of linear laws: one in the middle gives the tangents of all, unless they have a beginning, some that
  /// are far from each other the states that the others start from.
  void solve_directly(const std::vector<Index>& order) {
    std::vector<Index> left = order;
    const auto take = [&](auto which) {
      const Index point = *which;
      left.erase(which);
      return point;
    };
    Matrix places(where_.rows(), static_cast<Index>(left.size()));
    for (std::size_t i = 0; i < left.size(); ++i) {
      places.col(static_cast<Index>(i)) = where_.col(left[i]);
    }
    const Vector middle = places.rowwise().mean();
    const auto away = [this](Index point, const Vector& from) {
      return (where_.col(point) - from).squaredNorm();
    };
    set_tolerance();
    while ((known_.empty() || !linear_->made()) && !left.empty()) {  // until one has converged
      solve_alone(take(std::ranges::min_element(left, {},
                                                [&](Index point) { return away(point, middle); })),
                  true);
    }
    const bool begun = basis_.cols() > 0;  // by the points that all shares start from
    const Index far = begun ? 0 : std::min(most_far, static_cast<Index>(left.size()) / 2);
    std::vector<Index> seeds;
    while (static_cast<Index>(seeds.size()) < far) {
      const auto nearest_of = [&](Index point) {
        double least = std::numeric_limits<double>::infinity();
        for (const Index known : known_points_) {
          least = std::min(least, away(point, where_.col(known)));
        }
        for (const Index known : seeds) {
          least = std::min(least, away(point, where_.col(known)));
        }
        return least;
      };
      seeds.push_back(take(std::ranges::max_element(left, {}, nearest_of)));
    }
    if (!seeds.empty()) {
      try_together(seeds);
    }
    for (std::size_t next = 0; next < left.size();) {
      set_tolerance();
      const std::size_t count =
          std::min(left.size() - next, static_cast<std::size_t>(most_together_));
      try_together(std::span<const Index>(left.data() + next, count));
      next += count;
      if (scatter_.count() >= first_samples) {
        release_early();
      }
    }
  }

  /// The laws of some points side by side.
  [[nodiscard]] substructure::Laws laws_of(const substructure::Laws& base,
                                           std::span<const Index> points) const {
    std::vector<substructure::LawParameter> changes;
    for (const SweptParameter* each : own_parameters_) {
      const auto sets = static_cast<Index>(points.size());
      const bool in_time = each->columns > 1;
      const Index copies = in_time || sets == 1 ? 1 : amplitudes_.cols();
      const Index rows = each->pattern.rows() / each->columns;
      Matrix field(rows, sets * each->columns * copies);
      for (Index set = 0; set < sets; ++set) {
        const Vector values =
            each->pattern * each->values.col(points[static_cast<std::size_t>(set)]);
        field.middleCols(set * each->columns * copies, each->columns * copies) =
            values.reshaped(rows, each->columns).replicate(1, copies);
      }
      changes.push_back({each->interface, each->parameter, std::move(field)});
    }
    std::map<std::string, substructure::StiffnessFactors> factors;
    for (const SweptParameter* each : stiffness_) {
      substructure::StiffnessFactors& own = factors[each->interface];
      own.field = each->values.col(points.front());
      own.values = own.field.col(0);
    }
    return base.with_parameters(changes).with_stiffness(factors);
  }

  /// @throws InputError if it is not one number for each point
  static void check_stiffness(const SweptParameter& each) {
    if (each.pattern.rows() != 1 || !(each.pattern.array() == 1.0).all() || each.columns != 1) {
      throw InputError("sweep: the stiffness of '" + each.interface +
                       "' takes factors, with a pattern (1, factors) of ones");
    }
  }

  /// @throws InputError if a swept load does not fit the load patterns
  void check_load(const SweptParameter& load) const {
    if (load.pattern.rows() != amplitudes_.size()) {
      throw InputError("sweep: a load has a pattern of " + std::to_string(load.pattern.rows()) +
                       " rows for amplitudes of shape (" + std::to_string(amplitudes_.rows()) +
                       ", " + std::to_string(amplitudes_.cols()) + ")");
    }
  }

  /// What the swept loads of a point add to the amplitudes, (l, c).
  [[nodiscard]] Matrix loads_of(Index point) const {
    return loads_at(parameters_, point, amplitudes_.rows(), amplitudes_.cols());
  }

  /// Add the answer to the swept loads of a point to traces, or take it away.
  void shift(Matrix& traces, Index point, double sign) const {
    if (!loads_vary_ || scales_) {  // with factors the traces are made anew
      return;
    }
    const Matrix added = sign * loads_of(point);
    for (std::size_t b = 0; b < structure_.bodies().size(); ++b) {
      traces.middleRows(structure_.body_rows()[b], structure_.bodies()[b].rows()).noalias() +=
          laws_.response(b).traces * added;
    }
  }

  /// The solved points nearest to a place.
  [[nodiscard]] std::vector<const State*> nearest(const Vector& place, Index count) const {
    std::vector<std::size_t> order(known_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    const auto wanted =
        std::min(known_.size(), static_cast<std::size_t>(std::max<Index>(count, 1)));
    std::vector<double> away(known_.size());
    for (std::size_t i = 0; i < known_.size(); ++i) {
      away[i] = (place - where_.col(known_points_[i])).squaredNorm();
    }
    std::ranges::partial_sort(order, order.begin() + static_cast<std::ptrdiff_t>(wanted),
                              [&away](std::size_t a, std::size_t b) { return away[a] < away[b]; });
    std::vector<const State*> states;
    states.reserve(wanted);
    for (std::size_t i = 0; i < wanted; ++i) {
      states.push_back(&known_[order[i]]);
    }
    return states;
  }

  /// @throws Interrupted if the run was interrupted
  Summary solve_or_stop(Index point, const substructure::Laws& laws, State& state,
                        const std::vector<const State*>& start) {
    const Matrix amplitudes = loads_vary_ ? Matrix(amplitudes_ + loads_of(point)) : amplitudes_;
    Options options = options_;
    options.max_seconds = seconds_left();
    Summary summary = solve(laws, options, amplitudes, state, start, callback_, linear_);
    if (summary.status == Status::interrupted || summary.status == Status::time_limit) {
      ended_ = summary.status;
      throw Interrupted();
    }
    return summary;
  }

  /// Seconds that are left. @throws Interrupted on all ranks where none are. Collective.
  [[nodiscard]] double seconds_left() {
    if (options_.max_seconds == std::numeric_limits<double>::infinity()) {
      return options_.max_seconds;
    }
    const double spent =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    const double left = -structure_.communicator().largest(spent - options_.max_seconds);
    if (left <= 0.0) {
      ended_ = Status::time_limit;
      throw Interrupted();
    }
    return left;
  }

  /// The callback; that it asked for the end is noted, because a point that just converged does not heed it.
  Callback noting(const Callback& callback) {
    if (!callback) {
      return callback;
    }
    return [this, &callback](const Iteration& iteration) {
      try {
        callback(iteration);
      } catch (const Interrupted&) {
        stop_ = true;
        throw;
      }
    };
  }

  /// Whether a sample is right although its tolerance, which may be below what the scatter asks for, was not reached.
  [[nodiscard]] bool good_enough(const Summary& summary) const {
    return summary.status == Status::converged ||
           (follows_scatter() &&
            scatter_.relative(errors_of_bodies(summary)) <= enough_for_scatter * wanted_);
  }

  /// Of this rank's bodies, (bodies).
  [[nodiscard]] Vector errors_of_bodies(const Summary& summary) const {
    const auto bodies = static_cast<Index>(structure_.bodies().size());
    if (summary.errors.cols() == bodies && summary.errors.rows() > 0) {
      Vector largest(summary.errors.cols());
      for (Index body = 0; body < largest.size(); ++body) {
        largest(body) = largest_of(summary.errors.col(body), 0.0);
      }
      return largest;
    }
    return Vector::Constant(bodies, summary.error);
  }

  /// The first samples wait until it is known how exact their scatter wants them.
  void release_early() {
    while (!early_.empty()) {
      Early& first = early_.front();
      const substructure::Laws laws = laws_of(laws_, {&first.point, 1});
      if (first.summary.error > wanted_ * scatter_.least()) {
        set_tolerance();
        State state;
        Summary again = solve_or_stop(first.point, laws, state, {&first.state});
        again.iterations += first.summary.iterations;
        if (again.error < first.summary.error) {
          first.summary = std::move(again);
          first.state = std::move(state);
        }
      }
      const Early done = std::move(first);
      early_.erase(early_.begin());
      finish(done.point, laws, done.summary, done.state);
    }
  }

  /// As they are, after an interrupt.
  void hand_out_early() {
    for (const Early& first : early_) {
      try {
        finish(first.point, laws_of(laws_, {&first.point, 1}), first.summary, first.state);
      } catch (const Interrupted&) {
        continue;  // once is enough
      }
    }
    early_.clear();
  }

  /// @throws Interrupted on all ranks if a callback of any of them did
  void hand_out(Index point, const substructure::Laws& laws, Summary summary, const State& state) {
    if (follows_scatter() && !scatter_known_) {
      scatter_.add(state, errors_of_bodies(summary), [&](const State& first) {
        return substructure::GlobalStage(laws).sizes(first.data, first.traces,
                                                     amplitudes_ + loads_of(point));
      });
      if (scatter_.count() <= first_samples) {
        early_.push_back({point, state, std::move(summary)});
        return;
      }
    }
    finish(point, laws, std::move(summary), state);
  }

  /// @throws Interrupted on all ranks if a callback of any of them did
  void finish(Index point, const substructure::Laws& laws, Summary summary, const State& state) {
    if (follows_scatter()) {
      summary.scatter = scatter_.of_largest_error();
      if (summary.status != Status::converged && summary.status != Status::interrupted &&
          summary.error <= wanted_) {
        // of itself it is right; what the samples differ by may not be
        summary.status = good_enough(summary) ? Status::converged : Status::inexact;
      }
    }
    structure_.communicator().together([&] {
      try {
        point_callback_(point, laws, summary, state);
      } catch (const Interrupted&) {
        stop_ = true;
      }
    });
    if (structure_.communicator().maximum(stop_ ? 1 : 0) > 0) {
      throw Interrupted();
    }
  }

  /// @param wanted the state is start material even if others reproduce it: those near by did not
  /// @param tried  iterations of the point before, which gave no answer
  void solve_alone(Index point, bool wanted = false, Index tried = 0) {
    substructure::Laws laws = laws_;
    structure_.communicator().together([&] { laws = laws_of(laws_, {&point, 1}); });
    std::vector<const State*> start = nearest(where_.col(point), options_.snapshots);
    std::vector<State> shifted;  // their displacements under the loads of this point
    if (loads_vary_) {
      shifted.reserve(start.size());
      for (const State*& each : start) {
        shifted.push_back(*each);
        shift(shifted.back().traces, point, 1.0);
        each = &shifted.back();
      }
    }
    State state;
    Summary summary = solve_or_stop(point, laws, state, start);
    if (!good_enough(summary) && !start.empty()) {
      // friction may keep a state of other parameters in a trap: from zero it is another way
      State cold;
      Summary again = solve_or_stop(point, laws, cold, {});
      again.iterations += summary.iterations;
      if (again.status == Status::converged || again.error < summary.error) {
        state = std::move(cold);
        summary = std::move(again);
      } else {
        summary.iterations = again.iterations;
      }
    }
    const bool at_once = summary.status == Status::converged && summary.iterations <= 1;
    summary.iterations += tried;
    hand_out(point, laws, summary, state);
    const bool full = start.size() >= static_cast<std::size_t>(options_.snapshots);
    const bool reproduced = at_once && full;
    streak_ = reproduced ? streak_ + 1 : 0;
    // what has slid away at a loose tolerance leaves rounding to start from
    const double size = std::sqrt(structure_.communicator().sum(state.data.squaredNorm()));
    smallest_ = size > 0.0 ? std::min(smallest_, size) : smallest_;
    const bool near = size <= farthest_start * smallest_;
    if (summary.status == Status::converged && near && (wanted || !reproduced)) {
      shift(state.traces, point, -1.0);
      known_.push_back(std::move(state));
      known_points_.push_back(point);
    }
  }

  /// @throws Interrupted on all ranks if a callback of any of them did
  void report(const Iteration& iteration) {
    structure_.communicator().together([&] {
      try {
        if (callback_) {
          callback_(iteration);
        }
      } catch (const Interrupted&) {
        stop_ = true;
      }
    });
    if (structure_.communicator().maximum(stop_ ? 1 : 0) > 0) {
      throw Interrupted();
    }
  }

  /// One iteration for all of them; those that it does not answer are solved one by one.
  void try_together(std::span<const Index> points) {
    static_cast<void>(seconds_left());
    const auto start = std::chrono::steady_clock::now();
    Vector centre = Vector::Zero(where_.rows());
    for (const Index point : points) {
      centre += where_.col(point) / static_cast<double>(points.size());
    }
    const auto sets = static_cast<Index>(points.size());
    const std::vector<Advanced> answers = advance_together(
        laws_of(laws_.repeated(sets), points), options_, amplitudes_, sets,
        direct_ ? std::vector<const State*>{&known_.front()} : nearest(centre, together_from_),
        linear_.get(), direct_ ? &basis_ : nullptr);
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() /
        static_cast<double>(sets);
    std::vector<Index> missed;
    double worst = 0.0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Advanced& answer = answers[i];
      const double measure = options_.stop_on_indicator ? answer.indicator : answer.error;
      worst = measure > worst || std::isnan(measure) ? measure : worst;
      if (!(measure <= options_.rtol)) {
        missed.push_back(points[i]);
        continue;
      }
      Summary summary;
      summary.status = Status::converged;
      summary.iterations = 1;
      summary.error = answer.error;
      summary.errors = answer.errors;
      summary.indicator = answer.indicator;
      summary.energy = answer.energy;
      summary.history.push_back({1, answer.error, answer.indicator, answer.residual, seconds});
      report(summary.history.back());
      hand_out(points[i], laws_of(laws_, points.subspan(i, 1)), summary, answer.state);
    }
    // local stages of the snapshots are most of the work: no more of them than the tolerance asks for
    if (worst < spare_accuracy * options_.rtol) {
      together_from_ = std::max(fewest_snapshots, together_from_ - 1);
    } else if (!missed.empty()) {
      together_from_ = std::min(options_.snapshots, together_from_ + 3);
    }
    const Index answered = sets - static_cast<Index>(missed.size());
    for (const Index point : missed) {
      solve_alone(point, true, 1);
    }
    streak_ = 2 * answered > sets ? std::min(2 * sets, 2 * most_together_) : 0;
  }

  const substructure::Laws& laws_;
  const substructure::Structure& structure_;
  Options options_;
  Scatter scatter_;
  bool scatter_known_ = false;  ///< it is that of the first points, for all others
  struct Early {
    Index point;
    State state;
    Summary summary;
  };
  std::vector<Early> early_;  ///< the first samples
  double wanted_;             ///< tolerance asked for: that of the options follows the scatter
  const Matrix& amplitudes_;  ///< at all points, but for swept loads
  const std::vector<SweptParameter>& parameters_;
  bool loads_vary_ = false;
  std::vector<const SweptParameter*> stiffness_;
  bool scales_ =
      false;  ///< bodies have factors: tangents and traces of other points are not those of a point
  std::vector<const SweptParameter*> own_parameters_;  ///< of interfaces that are on this rank
  std::vector<State> known_;                           ///< without the answer to swept loads
  std::vector<Index> known_points_;
  double smallest_ = std::numeric_limits<double>::infinity();  ///< norm of the data of a point
  bool stop_ = false;                   ///< a callback of this rank asked for the end
  Status ended_ = Status::interrupted;  ///< as what it ends before all points are solved
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  const Callback callback_;
  const PointCallback& point_callback_;
  Matrix where_;
  Index most_together_ = 1;
  bool direct_ =
      false;      ///< all laws are linear: points are solved together, by conjugate gradients
  Matrix basis_;  ///< of these: what points move by from the first known one
  Index together_from_ = options_.snapshots;  ///< snapshots of points that are tried together
  /// Of the point solved last, where estimates are checked.
  std::shared_ptr<Linearisation> linear_;
  Beginning* beginning_ = nullptr;
  std::unique_ptr<Beginning> own_;      ///< while another sweep has the one that is kept
  std::unique_lock<std::mutex> taken_;  ///< a factor solves for one at a time
  Index streak_ = 0;                    ///< points in a row that needed one iteration
};

}  // namespace

const Linearisation& Beginning::of(const substructure::Laws& laws, const Matrix& amplitudes) {
  const bool same = laws_ == laws;
  if (same && amplitudes_.rows() == amplitudes.rows() && amplitudes_.cols() == amplitudes.cols() &&
      amplitudes_ == amplitudes) {
    return known_;
  }
  const auto made = std::make_shared<Linearisation>();
  if (same) {
    *made = known_;
    made->forget_rounding();
  }
  Options options;  // of no sweep, for it is the beginning of others, too
  options.rtol = 1e-10;
  State state;
  laws_.reset();
  try {
    solve(laws, options, amplitudes, state, {}, {}, made);
  } catch (const NumericalError&) {  // points may be stable where the laws themselves are not
    *made = Linearisation();
  }
  known_ = *made;
  amplitudes_ = amplitudes;
  laws_ = laws;
  return known_;
}

Status sweep(const substructure::Laws& laws, const Options& options, const Matrix& amplitudes,
             const std::vector<SweptParameter>& parameters, const std::vector<Index>& order,
             std::vector<State> known, std::vector<Index> known_points, const Callback& callback,
             const PointCallback& point_callback, const NextPoints& next, Beginning* beginning) {
  const SerialAlgebra serial;  // as in solve()
  if (known.size() != known_points.size()) {
    throw InputError("a sweep was given " + std::to_string(known.size()) + " states for " +
                     std::to_string(known_points.size()) + " points");
  }
  Sweep all(laws, options, amplitudes, parameters, std::move(known), std::move(known_points),
            callback, point_callback, beginning);
  all.check(order);
  return all.run(order, next);
}

}  // namespace latin::iteration
