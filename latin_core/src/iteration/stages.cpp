#include "latin/iteration/stages.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace latin::iteration {

using substructure::Problem;

Metric metric_of(const Problem& problem) {
  return Metric(problem.weights().cwiseQuotient(problem.directions()),
                [&problem](std::span<double> values) { problem.communicator().sum(values); });
}

Gauge gauge_of(const Problem& problem) {
  return {[&problem](ConstMatrixRef data, ConstMatrixRef traces) {
            return problem.difference_size(data, traces);
          },
          [&problem](const State& a, const State& b) {
            return problem.share_of_distance(a.data, a.traces, b.data, b.traces);
          }};
}

Stages::Stages(const Problem& problem, const Matrix& amplitudes, bool single_precision)
    : problem_(problem), amplitudes_(amplitudes), single_precision_(single_precision) {}

FixedPoint Stages::fixed_point() {
  FixedPoint stages{
      [this](Matrix& step, Matrix& data, Matrix& traces) { global(&step, data, traces); },
      [this](const Matrix& data, const Matrix& traces, Matrix& residual) {
        local(data, traces, residual);
      },
      {}};
  if (problem_.preconditions()) {
    stages.precondition = [this](MatrixRef residual) { problem_.precondition(residual); };
  }
  return stages;
}

void Stages::evaluate(Iterate at) {
  global(nullptr, at.state.data, at.state.traces);
  local(at.state.data, at.state.traces, at.residual);
}

void Stages::global(Matrix* step, Matrix& data, Matrix& traces) {
  const Timed timed(global_s_);
  rounded_ = step != nullptr && single_precision_;
  ++count_;
  attempt([&] {
    if (rounded_) {
      problem_.global_change(*step, traces);
    } else {
      problem_.global_stage(data, amplitudes_, traces);
    }
    if (problem_.balances()) {
      const Matrix added = problem_.balance(data, traces);
      if (step != nullptr) {
        *step += added;
      }
    }
  });
}

void Stages::local(const Matrix& data, const Matrix& traces, Matrix& residual) {
  const Timed timed(local_s_);
  attempt([&] { problem_.local_stage(data, traces, residual); });
}

void Stages::refresh(State& state) const {
  problem_.global_stage(state.data, amplitudes_, state.traces);
}

Measured Stages::measure(Iterate at, Anderson& history, const ErrorEstimate& error,
                         bool& stop) const {
  const substructure::Size size =
      problem_.share_of_size(at.state.data, at.state.traces, amplitudes_);
  const auto [distance, extent] =
      stage_shares(problem_.weights(), problem_.directions(), at.state, at.residual);
  constexpr std::size_t own = 8;
  std::array<double, own + 2 * Hindsight::most> sums{
      size.strain,
      size.trace,
      size.work,
      distance,
      extent,
      history.metric().share_of_square(at.state.data),
      failure_ ? 1.0 : 0.0,
      stop ? 1.0 : 0.0};
  std::ranges::copy(error.shares(at.state), sums.begin() + own);
  history.fit(at.residual, sums);
  if (sums[6] > 0.0) {
    agree();
  }
  stop = sums[7] > 0.0;
  Measured measured{history.residual_norm(),
                    std::sqrt(sums[5]),
                    stage_distance({sums[3], sums[4]}),
                    substructure::Size{sums[0], sums[1], sums[2]}.positive(),
                    {}};
  std::copy(sums.begin() + own, sums.end(), measured.distances.begin());
  return measured;
}

}  // namespace latin::iteration
