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

/// A step that leaves more than this of the one before says nothing.
constexpr double most_left = 0.5;
/// Steps below this are rounding.
constexpr double noise = 1e-12;

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

/// A step of Newton's method with the tangents of a near parameter set, and what the next one would change.
std::vector<Advanced> advance_by(const Linearisation& linear, const substructure::Laws& laws,
                                 const Options& options, const Matrix& amplitudes, Index sets,
                                 const std::vector<const State*>& snapshots) {
  const substructure::Structure& structure = laws.structure();
  const Index columns = amplitudes.cols();
  const Gauge gauge = gauge_of(structure, laws.groups());
  const Matrix all_amplitudes = amplitudes.replicate(1, sets);
  Anderson history(metric_of(structure), columns, static_cast<Index>(snapshots.size()), sets);
  Stages stages(laws, all_amplitudes, false);
  State state;
  Matrix residual(structure.rows(), sets * columns);
  Stepper(stages.fixed_point(), history, options.relaxation)
      .start_from(snapshots, {state, residual});
  stages.local(state.data, state.traces, residual);
  Matrix moved;
  Matrix step = residual;
  linear.correct(step, moved);
  const substructure::Sizes first = gauge.of_difference(step, moved);
  state.data += step;
  stages.evaluate({state, residual});
  step = residual;
  linear.correct(step, moved);
  const substructure::Sizes second = gauge.of_difference(step, moved);

  substructure::GlobalStage global(laws);
  const substructure::Yardstick yardstick = substructure::yardstick(structure, laws.groups());
  const substructure::Sizes whole = global.sizes(state.data, state.traces, all_amplitudes);
  const Index groups = whole.strain.rows() / sets;
  // neither at the answer nor where the next step would lead may a law have another branch
  const std::vector<bool> here = linear.near_columns(laws, state);
  const std::vector<bool> there =
      laws.linear() ? here : linear.near_columns(laws, {state.data + step, state.traces + moved});
  std::vector<Advanced> answers(static_cast<std::size_t>(sets));
  for (Index set = 0; set < sets; ++set) {
    const auto of_set = [set, columns](const Matrix& block) {
      return block.middleCols(set * columns, columns);
    };
    const auto sizes_of = [set, groups](const substructure::Sizes& sizes) {
      return substructure::Sizes{sizes.strain.middleRows(set * groups, groups),
                                 sizes.trace.middleRows(set * groups, groups),
                                 sizes.work.middleRows(set * groups, groups)};
    };
    Advanced& answer = answers[static_cast<std::size_t>(set)];
    answer.state = {of_set(state.data), of_set(state.traces)};
    answer.indicator = stage_distance(
        stage_shares(structure.weights(), structure.directions(), answer.state, of_set(residual)));
    answer.residual = history.metric().norm(of_set(residual));
    Whole mine{sizes_of(whole), yardstick};
    mine.yardstick.reach = mine.yardstick.share_of_reach(mine.sizes);
    answer.energy = mine.sizes.strain.sum();
    const Matrix before = mine.relative(sizes_of(first));
    const Matrix ahead = mine.relative(sizes_of(second));
    const Matrix left = (before.array() > 0.0).select(ahead.cwiseQuotient(before), 0.0);
    const bool shorter = ((left.array() <= most_left) || (ahead.array() <= noise)).all();
    answer.error = std::numeric_limits<double>::infinity();
    bool near = shorter;
    for (Index column = set * columns; column < (set + 1) * columns; ++column) {
      const auto at = static_cast<std::size_t>(column);
      near = near && here[at] && there[at];
    }
    if (near) {
      answer.errors = (ahead.array() / (1.0 - left.array().min(most_left))).matrix();
      answer.error = largest(answer.errors);
    }
  }
  return answers;
}

}  // namespace

std::vector<Advanced> advance_together(const substructure::Laws& laws, const Options& options,
                                       const Matrix& amplitudes, Index sets,
                                       const std::vector<const State*>& snapshots,
                                       const Linearisation* known) {
  refuse_transforms(laws);
  if (known != nullptr && known->made()) {
    return advance_by(*known, laws, options, amplitudes, sets, snapshots);
  }
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
