#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "iteration/anderson.hpp"
#include "iteration/error_estimate.hpp"
#include "iteration/newton_proposal.hpp"
#include "iteration/safeguard.hpp"
#include "iteration/stages.hpp"
#include "iteration/step.hpp"
#include "iteration/stopping_rule.hpp"
#include "iteration/verification.hpp"
#include "latin/common/types.hpp"
#include "latin/iteration/options.hpp"
#include "latin/iteration/state.hpp"
#include "latin/iteration/summary.hpp"
#include "substructure/laws.hpp"

namespace latin::iteration {

/// One solve: the local and the global stage in turn, until the stopping rule says how it ended.
///
/// What decides is elsewhere, each by itself: the error estimate, the stopping rule, the safeguard of the accelerated
/// steps, and the proposals of Newton's method. Here they are asked in their order.
class Run {
 public:
  /// @param state     where it starts, and where the answer is left
  /// @param snapshots number of those that start_from() will be given
  /// @param known, balanced see solve()
  Run(const substructure::Laws& laws, const Options& options, const Matrix& amplitudes,
      State& state, std::size_t snapshots, const Callback& callback,
      std::shared_ptr<Linearisation> known = {}, const Balanced& balanced = {});
  Run(const Run&) = delete;
  Run(Run&&) = delete;
  Run& operator=(const Run&) = delete;
  Run& operator=(Run&&) = delete;
  ~Run() = default;

  void start_from(const std::vector<const State*>& snapshots);
  /// @param traces_known whether the state has the traces of its data
  Summary run(bool traces_known);

 private:
  [[nodiscard]] bool accelerates() const { return options_.acceleration > 0; }
  [[nodiscard]] Iterate at() { return {state_, residual_}; }
  [[nodiscard]] Index iterations() const { return stages_.count() + newton_stages_; }
  [[nodiscard]] double elapsed() const;
  [[nodiscard]] double accuracy_of_fields() const;
  void begin(bool traces_known);
  bool solve_coupled();
  void evaluate_start();
  Measured observe();
  void report(const Measured& measured);
  void tell(const Iteration& iteration);
  void tell_again(Index steps);
  std::optional<Verification::Found> checked(const Measured& measured, bool goes_on);
  template <class Work>
  auto unless_ended(const Work& work) -> decltype(work());
  bool goes_on(Index steps);
  [[nodiscard]] Matrix estimate(const Measured& measured);
  Measured rescue(Measured measured);
  Measured verify(Measured measured, bool believed);
  [[nodiscard]] bool verifies() const;
  void advance(const Measured& measured);
  /// Seconds of some work added to a sum, but for those that are counted elsewhere.
  template <typename Work>
  auto timed(double& sum, Work&& work) {
    const auto counted = [this] {
      return stages_.global_seconds() + stages_.local_seconds() + summary_.callback_s;
    };
    const double before = counted();
    auto result = [&] {
      const Timed all(sum);
      return std::forward<Work>(work)();
    }();
    sum -= counted() - before;
    return result;
  }
  void propose();
  void propose(Index most);
  bool follow(const Measured& measured);
  State end_of_march();
  Summary end_at(Status lost);
  [[nodiscard]] bool late() const { return elapsed() > options_.max_seconds; }
  [[nodiscard]] std::optional<Status> wanted_end();
  void finish(Status status);
  void refuse_none();

  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  const substructure::Structure& structure_;
  const Options& options_;
  State& state_;
  const Callback& callback_;
  Matrix residual_;
  Stages stages_;
  Anderson history_;
  Stepper stepper_;
  ErrorEstimate error_;
  NewtonProposal newton_;
  StoppingRule stopping_;
  Safeguard safeguard_;
  std::shared_ptr<Linearisation> known_;
  std::optional<Verification> verification_;
  Matrix errors_;            ///< of the iterate
  bool rounding_ = false;    ///< a check found that more iterations are no use
  double next_check_ = 0.0;  ///< residual below which the next check is worth its price
  Summary summary_;
  Index newton_stages_ = 0;         ///< work of Newton's method, in global stages
  bool interrupted_ = false;        ///< on this rank
  bool first_round_ = false;        ///< whether the next one is the first of these:
  int rounds_left_ = 0;             ///< in which all columns may be solved for at once
  bool solved_ = false;             ///< for all columns at once: the next iterate is to be checked
  bool started_elsewhere_ = false;  ///< from states of other parameters
  bool stop_ = false;               ///< interrupted or late on some rank, as all know
};

}  // namespace latin::iteration
