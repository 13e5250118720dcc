#include "iteration/stages.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <exception>
#include <memory>
#include <utility>

#include "iteration/newton.hpp"
#include "iteration/sparse_skeleton.hpp"
#include "latin/common/error.hpp"
#include "substructure/interface_system.hpp"
#include "substructure/tangent.hpp"

namespace latin::iteration {

using substructure::Structure;

namespace {

/// Operations of a dense LU of the interfaces beside those of the factorisations of the bodies.
constexpr double affordable = 0.1;

/// Whether dense matrices of the interfaces cost less than the whole bodies once more.
bool prefers_dense(const substructure::Structure& structure) {
  const Index unknowns = structure.total_unknowns();
  const double operations = 2.0 / 3.0 * std::pow(static_cast<double>(unknowns), 3);
  return unknowns <= substructure::Structure::few_unknowns ||
         operations <= affordable * structure.work().factorise;
}

}  // namespace

Metric metric_of(const Structure& structure) {
  return Metric(structure.weights().cwiseQuotient(structure.directions()),
                [&structure](std::span<double> values) { structure.communicator().sum(values); });
}

Gauge gauge_of(const substructure::Laws& laws) {
  return {[laws](ConstMatrixRef data, ConstMatrixRef traces) {
            return substructure::sizes_of_difference(laws.structure(), laws.measured(), data,
                                                     traces, laws.in_time());
          },
          [laws](const State& a, const State& b) {
            return substructure::sizes_of_distance(laws.structure(), laws.measured(), a.data,
                                                   a.traces, b.data, b.traces, laws.in_time());
          }};
}

Stages::Stages(const substructure::Laws& laws, const Matrix& amplitudes, bool single_precision)
    : global_(laws),
      local_(laws, amplitudes.cols()),
      yardstick_(substructure::yardstick(laws.structure(), laws.measured())),
      amplitudes_(amplitudes),
      single_precision_(single_precision) {}

FixedPoint Stages::fixed_point() {
  FixedPoint stages{
      [this](Matrix& step, Matrix& data, Matrix& traces) { global(&step, data, traces); },
      [this](const Matrix& data, const Matrix& traces, Matrix& residual) {
        local(data, traces, residual);
      },
      {}};
  if (laws().preconditions()) {
    stages.precondition = [this](MatrixRef residual) {
      attempt([&] { laws().precondition(residual); });
    };
  }
  return stages;
}

void Stages::evaluate(Iterate at) {
  global(nullptr, at.state.data, at.state.traces);
  local(at.state.data, at.state.traces, at.residual);
}

bool Stages::try_evaluate(Iterate at) {
  std::exception_ptr failure;
  exact_ = true;
  ++count_;
  try {
    {
      const Timed timed(global_s_);
      attempt([&] { global_.apply(at.state.data, amplitudes_, at.state.traces); });
    }
    local(at.state.data, at.state.traces, at.residual);
  } catch (const NumericalError&) {
    return false;  // there is one rank
  }
  std::swap(failure, failure_);
  return structure().communicator().none_failed(failure);
}

void Stages::global(Matrix* step, Matrix& data, Matrix& traces) {
  const Timed timed(global_s_);
  exact_ = step == nullptr || !single_precision_;
  ++count_;
  attempt([&] {
    if (exact_) {
      global_.apply(data, amplitudes_, traces);
    } else {
      global_.change(*step, traces);
    }
  });
  if (structure().macro_size() > 0) {
    balance(step, data, traces);
  }
}

void Stages::balance(Matrix* step, Matrix& data, Matrix& traces) {
  Matrix imbalance = Matrix::Zero(structure().macro().size(), data.cols());
  if (!failed()) {
    attempt([&] { imbalance = global_.imbalance(local_, data, traces); });
  }
  structure().communicator().sum({imbalance.data(), static_cast<std::size_t>(imbalance.size())});
  attempt([&] {
    const Matrix added = global_.balance(imbalance, amplitudes_, data, traces);
    if (step != nullptr) {
      *step += added;
    }
  });
}

void Stages::local(const Matrix& data, const Matrix& traces, Matrix& residual) {
  const Timed timed(local_s_);
  attempt([&] { local_.apply(data, traces, residual); });
}

void Stages::refresh(State& state) {
  attempt([&] { global_.apply(state.data, amplitudes_, state.traces); });
  agree();
}

substructure::Sizes Stages::sizes(const State& state) {
  substructure::Sizes sizes =
      substructure::Sizes::zero(1, static_cast<Index>(structure().bodies().size()));
  if (!failed()) {  // what failed before may leave nothing to be measured
    attempt([&] { sizes = global_.sizes(state.data, state.traces, amplitudes_); });
  }
  return sizes;
}

void Stages::sum_and_agree(Vector& values) const {
  Vector all(values.size() + 1);
  all << values, failed() ? 1.0 : 0.0;
  structure().communicator().sum({all.data(), static_cast<std::size_t>(all.size())});
  if (all(values.size()) > 0.0) {
    agree();
  }
  values = all.head(values.size());
}

Whole Stages::whole(const State& state) {
  Whole whole{sizes(state), yardstick_};
  whole.yardstick.reach = whole.yardstick.share_of_reach(whole.sizes);
  sum_and_agree(whole.yardstick.reach);
  return whole;
}

Vector Stages::rounding_of(std::size_t body, const State& state, const Whole& whole) {
  const substructure::Body& of = structure().bodies()[body];
  const Index first = structure().body_rows()[body];
  const substructure::Body::Correction correction =
      of.correction(state.data.middleRows(first, of.rows()), amplitudes_, laws().response(body));
  const substructure::ColumnGroups groups = laws().groups();
  substructure::Sizes sizes =
      substructure::Sizes::zero(groups.count(correction.traces.cols()), whole.sizes.strain.cols());
  const auto at = static_cast<Index>(body);
  for (Index column = 0; column < correction.traces.cols(); ++column) {
    const Index group = groups.of(column);
    sizes.strain(group, at) += correction.strain(column);
    sizes.trace(group, at) += structure().trace_size(body, correction.traces.col(column));
  }
  if (const substructure::PatternTimes* in_time = laws().in_time()) {
    sizes = in_time->bounds(sizes, groups.kinds());
  }
  return whole.relative(sizes).col(at);
}

double Stages::strain(const State& state) {
  Vector strain = Vector::Constant(1, sizes(state).strain.sum());
  sum_and_agree(strain);
  return strain(0);
}

Measured Stages::measure(Iterate at, Anderson& history, bool& stop) {
  Measured measured;
  measured.whole = {sizes(at.state), yardstick_};
  const auto [distance, extent] =
      stage_shares(structure().weights(), structure().directions(), at.state, at.residual);
  const Vector reach = yardstick_.share_of_reach(measured.whole.sizes);
  Vector sums(6 + reach.size());
  sums << measured.whole.sizes.strain.sum(), distance, extent,
      history.metric().share_of_square(at.state.data), failure_ ? 1.0 : 0.0, stop ? 1.0 : 0.0,
      reach;
  history.fit(at.residual, {sums.data(), static_cast<std::size_t>(sums.size())});
  if (sums(4) > 0.0) {
    agree();
  }
  stop = sums(5) > 0.0;
  measured.residual = history.residual_norm();
  measured.data = std::sqrt(sums(3));
  measured.indicator = stage_distance({sums(1), sums(2)});
  measured.strain = sums(0);
  measured.whole.yardstick.reach = sums.tail(reach.size());
  return measured;
}

NewtonProposal::Solver Stages::newton(double tolerance, std::function<bool(Index)> goes_on,
                                      Balanced balanced) {
  if (!substructure::InterfaceSystem::suits(laws())) {
    return {};
  }
  const bool sparse = SparseSkeleton::possible(structure());
  bool dense = structure().has_flexibility() && (!sparse || prefers_dense(structure()));
  if (!dense && !sparse) {
    return {};
  }
  return [this, tolerance, dense, goes_on = std::move(goes_on), balanced = std::move(balanced),
          newton = std::shared_ptr<Newton>()](State& state, Index most) mutable {
    double seconds = 0.0;
    const auto make = [&] {
      const Timed timed(seconds);
      newton = std::make_shared<Newton>(global_, amplitudes_, dense, goes_on, balanced);
    };
    if (!newton) {
      make();
    }
    NewtonOutcome outcome = newton->solve(state, tolerance, most);
    // what they have not solved
    if (!dense && !outcome.lost && outcome.solved < std::min(most, state.data.cols()) &&
        structure().has_flexibility() && substructure::Tangent::bearable(structure()) &&
        goes_on(outcome.steps)) {
      dense = true;
      make();
      const NewtonOutcome further = newton->solve(state, tolerance, most);
      outcome = {further.solved,
                 outcome.stages + further.stages,
                 outcome.steps + further.steps,
                 0.0,
                 further.lost,
                 further.falls,
                 further.hangs_on_nothing};
    }
    outcome.flexibility_s = seconds;
    return outcome;
  };
}

/// What the factors of bodies leave, which no iteration sees: measured where it may decide and can be, else a bound.
/// Collective.
Matrix Stages::with_rounding_of_bodies(Matrix errors, const State& state, double accuracy_of_fields,
                                       double rtol) {
  const auto& bodies = structure().bodies();
  const auto measurable = [&](std::size_t b) {
    return bodies[b].measurable() && laws().scaled(b) == nullptr && laws().field(b) == nullptr;
  };
  bool measures = false;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    auto own = errors.col(static_cast<Index>(b));
    const substructure::FieldColumns* field = laws().field(b);
    if (field != nullptr && field->chaos != nullptr) {
      own = larger(own, accuracy_of_fields);
    }
    if (measurable(b)) {
      measures = true;
    } else {
      own = larger(own, std::min(bodies[b].rounding(), rtol));
    }
  }
  if (structure().communicator().everywhere(!measures)) {
    return errors;
  }
  const Whole relative_to = whole(state);
  const Vector strains = relative_to.yardstick.rounding_of_strains(relative_to.sizes);
  const auto measure = [&](std::size_t b) {
    auto own = errors.col(static_cast<Index>(b));
    const double expected = larger(bodies[b].rounding(), strains(static_cast<Index>(b)));
    if (!measurable(b) || expected <= own.maxCoeff<keep_nan>()) {
      return;
    }
    const Vector found = rounding_of(b, state, relative_to);
    // a little more than the tolerance may be as well a little less
    const bool bearable = found.maxCoeff<keep_nan>() <= bearable_rounding * rtol;
    own = larger(own, bearable ? Vector(found.cwiseMin(rtol)) : found);
  };
  attempt([&] {
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      measure(b);
    }
  });
  agree();
  return errors;
}

}  // namespace latin::iteration
