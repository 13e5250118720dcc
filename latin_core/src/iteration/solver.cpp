#include "latin/iteration/solver.hpp"

#include <string>

#include "latin/common/error.hpp"
#include "latin/iteration/run.hpp"

namespace latin::iteration {

using substructure::Problem;

Summary solve(const Problem& problem, const Options& options, const Matrix& amplitudes,
              State& state, const std::vector<const State*>& snapshots, const Callback& callback) {
  const Index columns = amplitudes.cols();
  const auto fit = [&problem, columns](const State& each) {
    if (each.data.rows() != problem.rows() || each.data.cols() != columns ||
        each.traces.rows() != problem.rows() || each.traces.cols() != columns) {
      throw InputError("a start state has shape (" + std::to_string(each.data.rows()) + ", " +
                       std::to_string(each.data.cols()) + "), this problem needs (" +
                       std::to_string(problem.rows()) + ", " + std::to_string(columns) + ")");
    }
  };
  const bool from_zero = state.data.size() == 0;
  const Index most = problem.communicator().maximum(columns);
  problem.communicator().together([&] {
    options.check();
    if (amplitudes.rows() != problem.loads()) {
      throw InputError("amplitudes of " + std::to_string(amplitudes.rows()) +
                       " load patterns, this problem has " + std::to_string(problem.loads()));
    }
    if (columns != most) {
      throw InputError(std::to_string(columns) + " columns on this rank, " + std::to_string(most) +
                       " on another");
    }
    problem.check_columns(columns);
    for (const State* snapshot : snapshots) {
      fit(*snapshot);
    }
    if (snapshots.empty() && !from_zero) {
      fit(state);
    }
  });
  Run run(problem, options, amplitudes, state, snapshots.size(), callback);
  if (!snapshots.empty()) {
    run.start_from(snapshots);
    return run.run(true);
  }
  if (from_zero) {
    state.data = Matrix::Zero(problem.rows(), columns);
    state.traces = Matrix::Zero(problem.rows(), columns);
  }
  return run.run(false);
}

}  // namespace latin::iteration
