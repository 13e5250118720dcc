#pragma once

#include <functional>
#include <optional>

#include "iteration/metric.hpp"
#include "latin/common/types.hpp"
#include "latin/iteration/state.hpp"
#include "latin/iteration/summary.hpp"

namespace latin::iteration {

/// What Newton's method did with the columns of an iterate.
struct NewtonOutcome {
  Index solved = 0;     ///< columns solved, from the first; the others stay as they were
  double stages = 0.0;  ///< work in global stages of all columns, the factorisations not counted
  Index steps = 0;      ///< Newton steps of single columns
  double flexibility_s = 0.0;  ///< seconds of the flexibility of the bodies, where it was made
  /// Why the next column has no equilibrium on the way there: Status::no_equilibrium, or Status::slides.
  std::optional<Status> lost;
  /// By what share of itself the load of each column has to fall on the way of its bonds; empty: it was not solved.
  Vector falls;
  /// Whether something of an answer hangs on nothing: any place of that is one.
  bool hangs_on_nothing = false;
};

/// When Newton's method is tried, what it proposes, and whether the run follows.
///
/// A proposal is a step on the data with its traces and with the residual it leads to. Where Newton's method fails,
/// the accelerated iteration goes on as if nothing had been tried, for a longer while each time.
class NewtonProposal {
 public:
  /// Solve from a state: its columns are replaced. @throws NumericalError where there is no such method
  /// @param most columns that are solved
  using Solver = std::function<NewtonOutcome(State&, Index most)>;
  /// Residual of a state: the local stage.
  using Residual = std::function<void(const State&, Matrix&)>;

  /// @param metric of data and residuals
  /// @param solver empty: Newton's method is not possible, nothing is ever due
  NewtonProposal(Metric metric, Solver solver, Residual residual);

  [[nodiscard]] bool possible() const { return static_cast<bool>(solver_); }
  /// Wait before the first proposal, from a start that says little (zero) or much (other parameters).
  /// @param unknowns of the interfaces: what a proposal costs
  /// @param most_iterations that the run may take
  /// @param patience steps that cost no more than a proposal, see Options::newton; 0: only where the run would give up
  void begin(bool from_zero, Index unknowns, Index most_iterations, Index patience);
  /// Whether there is a proposal that nobody has asked for yet.
  [[nodiscard]] bool untried() const { return possible() && !tried_; }
  /// Whether a proposal is to be made now.
  [[nodiscard]] bool due() const { return due_within(0); }
  /// Whether one is to be made after so many steps, or fewer.
  [[nodiscard]] bool due_within(Index steps) const { return possible() && wait_ <= steps; }
  /// A step was taken without following.
  void count_step() { wait_ = wait_ > 0 ? wait_ - 1 : 0; }

  /// Where Newton's method leads from an iterate; nothing if that is not finite, or an answer already.
  /// @return what it took
  NewtonOutcome propose(Iterate from) { return propose(from, from.state.data.cols()); }
  /// The same in the first columns alone.
  NewtonOutcome propose(Iterate from, Index most);
  /// Forget the proposal: the iterate is another.
  void withdraw() { made_ = false; }
  [[nodiscard]] bool made() const { return made_; }
  /// Whether the proposal solves all columns.
  [[nodiscard]] bool whole() const { return made_ && columns_ == step_.data.cols(); }
  /// Whether some proposal has failed.
  [[nodiscard]] bool failed_before() const { return failures_ > 0; }
  /// Columns that the proposal has solved.
  [[nodiscard]] Index columns() const { return columns_; }
  /// Why the next one has no equilibrium, if it says so.
  [[nodiscard]] std::optional<Status> lost() const { return made_ ? lost_ : std::nullopt; }

  /// Whether something of what it solves hangs on nothing.
  [[nodiscard]] bool hangs_on_nothing() const { return made_ && hangs_on_nothing_; }

  /// The proposed change of data and traces.
  [[nodiscard]] const State& step() const { return step_; }
  /// |r| of the proposal.
  [[nodiscard]] double residual_norm() const { return norm_; }
  /// The share of the residual that is left, if the proposal is the error of the iterate before it: all columns
  /// are solved, and no body flies off.
  /// @param residual, data norms of the iterate
  [[nodiscard]] std::optional<double> left(double residual, double data) const;
  /// Move the iterate to the proposal, if that solved all columns or more than the last time.
  /// @return whether it did
  [[nodiscard]] bool follow(double residual, double data, Iterate at);

 private:
  [[nodiscard]] bool sane(double residual, double data) const;

  Metric metric_;
  Solver solver_;
  Residual residual_of_;
  State step_;
  Matrix residual_;      ///< after the step
  double length_ = 0.0;  ///< |step|
  double norm_ = 0.0;    ///< |residual_|
  bool made_ = false;
  bool tried_ = false;
  std::optional<Status> lost_;
  bool hangs_on_nothing_ = false;
  Index columns_ = 0;         ///< that the proposal has solved
  Index solved_ = 0;          ///< that the last one followed had solved
  Index wait_ = 0;            ///< iterations until the next proposal
  Index wait_after_failure_;  ///< after the next failure
  Index failures_ = 0;
};

}  // namespace latin::iteration
