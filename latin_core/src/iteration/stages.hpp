#pragma once

#include <chrono>
#include <exception>
#include <functional>
#include <utility>

#include "iteration/error_estimate.hpp"
#include "iteration/metric.hpp"
#include "iteration/newton_proposal.hpp"
#include "iteration/step.hpp"
#include "latin/common/types.hpp"
#include "latin/iteration/summary.hpp"
#include "substructure/global_stage.hpp"
#include "substructure/local_stage.hpp"

namespace latin::iteration {

/// W/k of the rows of a structure, summed over its ranks. It refers to the structure.
[[nodiscard]] Metric metric_of(const substructure::Structure& structure);
/// The sizes of their solutions, at the times where columns are load patterns.
[[nodiscard]] Gauge gauge_of(const substructure::Laws& laws);

/// Adds the seconds of a scope to a sum.
class Timed {
 public:
  explicit Timed(double& sum) : sum_(sum) {}
  Timed(const Timed&) = delete;
  Timed(Timed&&) = delete;
  Timed& operator=(const Timed&) = delete;
  Timed& operator=(Timed&&) = delete;
  ~Timed() {
    sum_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  double& sum_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// The two stages of a structure as a run asks for them: with its loads, counted and timed, and so that what fails
/// on one rank alone is told when all meet.
class Stages {
 public:
  /// @param amplitudes (l, c) of the load patterns; they must outlive this object
  /// @param single_precision steps change the traces in single precision
  /// @throws InputError naming the interface if the laws do not fit so many columns
  Stages(const substructure::Laws& laws, const Matrix& amplitudes, bool single_precision);
  Stages(const Stages&) = delete;
  Stages(Stages&&) = delete;
  Stages& operator=(const Stages&) = delete;
  Stages& operator=(Stages&&) = delete;
  ~Stages() = default;

  [[nodiscard]] const substructure::Laws& laws() const { return global_.laws(); }
  [[nodiscard]] const substructure::Structure& structure() const { return laws().structure(); }
  [[nodiscard]] const Matrix& amplitudes() const { return amplitudes_; }
  /// See GlobalStage.
  void set_accuracy_of_fields(double accuracy) { global_.set_accuracy_of_fields(accuracy); }
  /// What a step goes through. It refers to this object.
  [[nodiscard]] FixedPoint fixed_point();
  /// Both stages, in double precision, from data alone.
  void evaluate(Iterate at);
  /// The same without the coarse problem, which Newton's steps on the whole structure do not need, and where the laws
  /// may have no answer. Collective.
  /// @return whether they have one on all ranks
  [[nodiscard]] bool try_evaluate(Iterate at);
  /// Residual of a state.
  void local(const Matrix& data, const Matrix& traces, Matrix& residual);
  /// Traces in double precision, at the end: not counted. Collective. @throws as agree()
  void refresh(State& state);
  /// Whether the traces are those of the data in double precision: not where they hold changes in single
  /// precision, nor where a caller says what they are. An iterate is only accepted with traces that are.
  [[nodiscard]] bool exact() const { return exact_; }
  void set_exact(bool exact) { exact_ = exact; }

  /// Do what may fail on one rank and not on others. They wait for this one until the next reduction, where
  /// all learn of it.
  template <typename Work>
  void attempt(Work&& work) {
    try {
      std::forward<Work>(work)();
    } catch (...) {
      if (structure().communicator().alone()) {
        throw;
      }
      failure_ = failure_ ? failure_ : std::current_exception();
    }
  }
  /// Whether something has failed on this rank.
  [[nodiscard]] bool failed() const { return failure_ != nullptr; }
  /// Throw if something has failed on any rank. Collective.
  void agree() const { structure().communicator().agree(failure_); }

  /// Fit the history to the residual of an iterate, and measure it: all numbers that decide anything go through
  /// this one reduction and that of the error estimate. Collective. @throws as agree()
  /// @param stop whether this rank wants to end the run; afterwards: whether any does
  [[nodiscard]] Measured measure(Iterate at, Anderson& history, bool& stop);
  /// Sizes of a solution on this rank, and what they are relative to. Collective. @throws as agree()
  [[nodiscard]] Whole whole(const State& state);
  /// What rounding leaves of the displacements of a body, relative to it, (groups).
  [[nodiscard]] Vector rounding_of(std::size_t body, const State& state, const Whole& whole);
  /// Errors (groups, bodies) with what the factors of the bodies leave. Collective. @throws as agree()
  [[nodiscard]] Matrix with_rounding_of_bodies(Matrix errors, const State& state,
                                               double accuracy_of_fields, double rtol);
  /// Twice the strain energy of a solution. Collective. @throws as agree()
  [[nodiscard]] double strain(const State& state);
  /// Newton's method on the same stages; what it needs is made when first asked for. It refers to this object.
  /// @param tolerance on the forces, relative to the largest column of them
  /// @param goes_on, balanced see Newton
  /// @return empty where it is not possible, or of no use
  [[nodiscard]] NewtonProposal::Solver newton(double tolerance, std::function<bool(Index)> goes_on,
                                              Balanced balanced);

  /// Global stages so far.
  [[nodiscard]] Index count() const { return count_; }
  [[nodiscard]] double global_seconds() const { return global_s_; }
  [[nodiscard]] double local_seconds() const { return local_s_; }

 private:
  /// Sizes of a solution; nothing where that has failed on this rank.
  substructure::Sizes sizes(const State& state);
  /// Sum over the ranks, and throw as agree() if something has failed on any of them.
  void sum_and_agree(Vector& values) const;
  /// @param step of which alone the traces change in single precision; null: in double precision
  void global(Matrix* step, Matrix& data, Matrix& traces);
  void balance(Matrix* step, Matrix& data, Matrix& traces);

  substructure::GlobalStage global_;
  substructure::LocalStage local_;
  substructure::Yardstick yardstick_;
  const Matrix& amplitudes_;
  bool single_precision_;
  bool exact_ = true;
  Index count_ = 0;
  double global_s_ = 0.0;
  double local_s_ = 0.0;
  std::exception_ptr failure_;  ///< of this rank, until the ranks agree on it
};

}  // namespace latin::iteration
