#include "latin/study.hpp"

#include <cmath>
#include <limits>
#include <utility>

#include "common/numbers.hpp"
#include "iteration/solver.hpp"
#include "study/implementation.hpp"

namespace latin {
namespace {

/// Statuses of the steps: what docs/statuses.md says of them. Collective.
std::vector<Status> statuses_of(const Summary& summary, const substructure::Laws& laws,
                                Index columns, double rtol) {
  const substructure::ColumnGroups groups = laws.measured();
  const Index kinds = groups.kinds();
  const Index steps = laws.in_time() == nullptr ? groups.count(columns) / kinds : groups.steps;
  std::vector<Status> found(static_cast<std::size_t>(steps), summary.status);
  if (summary.status == Status::converged) {
    return found;
  }
  const bool ends = summary.status == Status::no_equilibrium || summary.status == Status::slides;
  bool good = true;
  for (Index step = 0; step < steps; ++step) {
    const bool known = summary.errors.rows() == steps * kinds;
    const auto own = summary.errors.middleRows(known ? step * kinds : 0, known ? kinds : 0);
    const double error = laws.structure().communicator().largest(
        !known ? std::numeric_limits<double>::infinity() : largest_of(own.reshaped(), 0.0));
    // columns that are no history are answers by themselves
    good = (good || groups.steps == 1) && error <= rtol;
    if (good || (ends && std::isfinite(error))) {
      found[static_cast<std::size_t>(step)] = good ? Status::converged : Status::inexact;
    }
  }
  return found;
}

Solution solution_of(const substructure::Laws& laws, const Matrix& amplitudes, State state,
                     const Summary& summary, double rtol) {
  std::vector<Status> statuses = statuses_of(summary, laws, amplitudes.cols(), rtol);
  return Solution(std::make_shared<const Solution::Implementation>(
      laws, amplitudes, std::move(state), summary, std::move(statuses)));
}

}  // namespace

Study::Study(std::vector<BodyDescription> bodies, std::vector<InterfaceDescription> interfaces,
             const Communicator& communicator, const OperatorOptions& options) {
  const auto structure = std::make_shared<const substructure::Structure>(
      std::move(bodies), std::move(interfaces), options, communicator);
  implementation_ = std::make_shared<const Implementation>(substructure::Laws(structure),
                                                           Matrix::Ones(structure->loads(), 1));
}

Study Study::with_parameters(const std::vector<LawParameter>& parameters) const {
  Implementation changed = *implementation_;
  changed.laws = changed.laws.with_parameters(parameters);
  return Study(std::make_shared<const Implementation>(std::move(changed)));
}

Study Study::with_parameter(const std::string& interface, const std::string& parameter,
                            double value) const {
  return with_parameters({{interface, parameter, Matrix::Constant(1, 1, value)}});
}

Study Study::with_loads(Matrix amplitudes) const {
  Implementation changed = *implementation_;
  const Index patterns = changed.laws.structure().loads();
  if (amplitudes.rows() != patterns || amplitudes.cols() < 1 || !amplitudes.allFinite()) {
    throw InputError("amplitudes of shape (" + std::to_string(amplitudes.rows()) + ", " +
                     std::to_string(amplitudes.cols()) +
                     "): give finite numbers, a row for each of the " + std::to_string(patterns) +
                     " load patterns and a column at least");
  }
  changed.laws = changed.laws.with_steps(1);
  changed.amplitudes = std::move(amplitudes);
  return Study(std::make_shared<const Implementation>(std::move(changed)));
}

Study Study::with_history(Matrix amplitudes) const {
  const Index steps = amplitudes.cols();
  Implementation changed = *with_loads(std::move(amplitudes)).implementation_;
  changed.laws = changed.laws.with_steps(steps);
  return Study(std::make_shared<const Implementation>(std::move(changed)));
}

Solution Study::solve(const SolveOptions& options) const {
  const auto& [laws, amplitudes, beginning] = *implementation_;
  State state = options.start;
  const Summary summary = iteration::solve(laws, options, amplitudes, state, {}, options.callback);
  return solution_of(laws, amplitudes, std::move(state), summary, options.rtol);
}

Status Study::sweep(const Points& points, const SweepOptions& options,
                    const PointCallback& each) const {
  const auto& [laws, amplitudes, beginning] = *implementation_;
  std::vector<State> states;
  std::vector<Index> solved;
  for (const auto& [point, state] : options.solved) {
    solved.push_back(point);
    states.push_back(state);
  }
  std::vector<Index> order = points.order;
  std::erase_if(order, [&](Index point) { return options.solved.contains(point); });
  return iteration::sweep(
      laws, options, amplitudes, points.parameters, order, std::move(states), std::move(solved),
      options.callback,
      [&](Index point, const substructure::Laws& of_point, const Summary& summary,
          const State& state) {
        const Matrix loads = amplitudes + iteration::loads_at(points.parameters, point,
                                                              amplitudes.rows(), amplitudes.cols());
        each(point, solution_of(of_point, loads, state, summary, options.rtol));
      },
      {}, beginning.get());
}

std::vector<std::string> Study::interfaces() const {
  std::vector<std::string> names;
  for (const substructure::ActiveInterface& each : implementation_->laws.structure().interfaces()) {
    names.push_back(each.name());
  }
  return names;
}

bool Study::has_first_side(const std::string& interface) const {
  const substructure::Structure& structure = implementation_->laws.structure();
  return structure.interface(structure.find_interface(interface)).rows.front() >= 0;
}

std::vector<std::string> Study::parts() const {
  std::vector<std::string> names;
  for (const std::vector<std::string>& body : implementation_->laws.structure().members()) {
    names.insert(names.end(), body.begin(), body.end());
  }
  return names;
}

}  // namespace latin
