#include "iteration/solver.hpp"

#include <string>
#include <vector>

#include "common/threads.hpp"
#include "iteration/run.hpp"
#include "latin/common/error.hpp"
#include "substructure/global_stage.hpp"

namespace latin::iteration {

Summary solve(const substructure::Laws& laws, const Options& options, const Matrix& amplitudes,
              State& state, const std::vector<const State*>& snapshots, const Callback& callback,
              const std::shared_ptr<Linearisation>& known, const Balanced& balanced) {
  const substructure::Structure& structure = laws.structure();
  const SerialAlgebra serial;  // what pays is cut into pieces here, and sums do not depend on it
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
    options.check();
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
  if (known && !known->fits(laws)) {
    *known = Linearisation();
  }
  Run run(laws, options, amplitudes, state, snapshots.size(), callback, known, balanced);
  if (!snapshots.empty()) {
    if (structure.total_rows() > 0 && laws.scales_anywhere()) {
      // their traces are those with other factors of the stiffness
      std::vector<State> moved;
      moved.reserve(snapshots.size());
      std::vector<const State*> own;
      substructure::GlobalStage global(laws);
      structure.communicator().together([&] {
        for (const State* each : snapshots) {
          moved.push_back(*each);
          global.apply(moved.back().data, amplitudes, moved.back().traces);
          own.push_back(&moved.back());
        }
      });
      run.start_from(own);
    } else if (structure.total_rows() > 0) {
      run.start_from(snapshots);
    } else {
      state = *snapshots.front();  // everything is assembled: BLAS does not take empty blocks
    }
    return run.run(true);
  }
  if (from_zero) {
    state.data = Matrix::Zero(structure.rows(), columns);
    state.traces = Matrix::Zero(structure.rows(), columns);
  }
  return run.run(false);
}

}  // namespace latin::iteration
