#include "latin/iteration/batch.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <string>

#include "latin/common/error.hpp"
#include "latin/iteration/anderson.hpp"
#include "latin/iteration/error_estimate.hpp"
#include "latin/iteration/stages.hpp"
#include "latin/iteration/step.hpp"

namespace latin::iteration {
namespace {

/// The transforms of an interface are those of one set: the columns of several would not fit them.
void refuse_transforms(const substructure::Laws& laws) {
  const auto& interfaces = laws.structure().interfaces();
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    if (laws.of(i).transformed()) {
      throw InputError(
          "interface '" + interfaces[i].name() +
          "': parameter sets are not solved side by side where columns are transformed");
    }
  }
}

}  // namespace

std::vector<Advanced> advance_together(const substructure::Laws& laws, const Options& options,
                                       const Matrix& amplitudes, Index sets,
                                       const std::vector<const State*>& snapshots) {
  refuse_transforms(laws);
  const substructure::Structure& structure = laws.structure();
  const Index columns = amplitudes.cols();
  const Gauge gauge = gauge_of(structure, laws.groups());
  const Matrix all_amplitudes = amplitudes.replicate(1, sets);
  Anderson history(metric_of(structure), columns, static_cast<Index>(snapshots.size()), sets);
  Stages stages(laws, all_amplitudes, false);
  Stepper stepper(stages.fixed_point(), history, options.relaxation);
  State state;
  Matrix residual(structure.rows(), sets * columns);
  stepper.start_from(snapshots, {state, residual});
  stages.local(state.data, state.traces, residual);
  history.fit(residual);
  stepper.step(Stepper::Kind::accelerated, {state, residual});
  history.fit(residual);

  substructure::GlobalStage global(laws);
  const substructure::Yardstick yardstick = substructure::yardstick(structure, laws.groups());
  const State& wrong = history.predicted_error();
  std::vector<Advanced> answers(static_cast<std::size_t>(sets));
  for (Index set = 0; set < sets; ++set) {
    const auto of_set = [set, columns](const Matrix& block) {
      return block.middleCols(set * columns, columns);
    };
    Advanced& answer = answers[static_cast<std::size_t>(set)];
    answer.state = {of_set(state.data), of_set(state.traces)};
    answer.indicator = stage_distance(
        stage_shares(structure.weights(), structure.directions(), answer.state, of_set(residual)));
    answer.residual = history.residual_norm(set);
    Whole whole{global.sizes(answer.state.data, answer.state.traces, amplitudes), yardstick};
    whole.yardstick.reach = whole.yardstick.share_of_reach(whole.sizes);
    answer.energy = whole.sizes.strain.sum();
    answer.error = std::numeric_limits<double>::infinity();
    const double rounding = rounding_share * history.metric().norm(answer.state.data);
    if (answer.residual > rounding && history.explained(set) >= least_explained) {
      answer.errors = predicted_errors(gauge, of_set(wrong.data), of_set(wrong.traces),
                                       history.explained(set), whole);
      answer.error = std::max(largest(answer.errors), least_of_indicator * answer.indicator);
    }
  }
  return answers;
}

}  // namespace latin::iteration
