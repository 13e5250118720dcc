#include "latin/iteration/newton.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace latin::iteration {
namespace {

constexpr double with_mu = 1.0 + 2.0 * substructure::Flexibility::mu;
/// Steps without a better residual before another tangent is tried, and a residual that counts as better.
constexpr Index most_idle_steps = 5;
constexpr double better = 0.5;
/// A residual that grew by so much is not followed.
constexpr double growth = 1e4;
constexpr Index most_steps = 40;
/// Shortest step of the line search.
constexpr double shortest = 0.06;
/// A residual that no step makes better is rounding if it is below this share of the forces.
constexpr double rounding_of_forces = 1e-9;
/// A column whose residual is below this share of the forces starts where it is.
constexpr double close = 1e-2;
/// Global stages before an attempt at a column, twice as many before each further one.
constexpr Index first_relaxation = 6;
constexpr Index last_relaxation = 48;
/// Unknowns for which a factorisation costs as much as a global stage more.
constexpr Index unknowns_per_stage = 100;
/// Residual of the two stages, beside the data, from which Newton's method needs no more of them.
constexpr double near = 1e-3;
/// The same before each further attempt, beside that before it.
constexpr double nearer = 1e-2;
/// Residual of an attempt that failed, beside that at its start, from which the next one goes on.
constexpr double halfway = 0.3;

}  // namespace

Newton::Newton(substructure::GlobalStage& global, const Matrix& amplitudes)
    : amplitudes_(amplitudes),
      system_(global),
      flexibility_(global.laws().structure().flexibility()),
      layout_(system_.layout()),
      own_(system_.law_flexibility(flexibility_.own())),
      metric_(own_.cwiseProduct(flexibility_.areas())),
      tangent_system_(flexibility_, layout_, own_ + flexibility_.direct()),
      subspace_(system_),
      memory_(system_.blank()) {
  if (const Matrix& jumps = flexibility_.modal_jumps(); jumps.cols() > 0) {
    const Matrix weighted = metric_.cwiseSqrt().asDiagonal() * jumps;
    modes_ = Eigen::HouseholderQR<Matrix>(weighted).householderQ() *
             Matrix::Identity(jumps.rows(), std::min(jumps.rows(), jumps.cols()));
  } else {
    modes_.resize(jumps.rows(), 0);
  }
}

/// Forces count by the work that they do on the bodies: the meshes do not determine all of them, and what moves
/// nothing need not be known. Modes have no share in the flexibility: resultants count as forces do by themselves.
double Newton::norm(const Vector& force, const Vector& moved) const {
  const Vector given = own_.cwiseProduct(force) - moved;
  const double work = given.cwiseProduct(flexibility_.areas()).dot(force);
  const Vector resultants = modes_.transpose() * force.cwiseProduct(metric_.cwiseSqrt());
  return system_.follow_first(std::sqrt(std::max(work, 0.0) + resultants.squaredNorm()));
}

double Newton::size_of_forces(const Matrix& data, const Matrix& traces) const {
  double size = 0.0;
  const auto grow = [&](const Vector& force) {
    size = std::max(size, norm(force, tangent_system_.moved(force, Vector())));
  };
  auto memory = system_.blank();
  for (Index index = 0; index < data.cols(); ++index) {
    if (index % system_.laws().steps() == 0) {
      memory = system_.blank();
    }
    const Matrix jump = system_.free_jumps(data.col(index), traces.col(index));
    grow(system_.advance(index, memory, jump.col(0), system_.direct()));
  }
  if (size == 0.0) {  // all open: the data, as forces
    for (Index index = 0; index < data.cols(); ++index) {
      grow(flexibility_.force(data.col(index)));
    }
  }
  return size;
}

Newton::Column Newton::begin(const State& state, Index index) {
  Column column;
  column.index = index;
  // as the iteration sees it: the forces of the laws at the jumps of this iterate
  const auto data = state.data.col(index);
  const auto traces = state.traces.col(index);
  const Matrix free = system_.free_jumps(data, traces);
  column.before = system_.forces(index, memory_, free.col(0), system_.direct());
  // F / 2 = E f - (s - k w)
  const Vector half_residual =
      flexibility_.spread(column.before) - data + system_.directions().cwiseProduct(traces);
  column.half = flexibility_.solve(half_residual);
  column.jump = free + flexibility_.jump(2.0 * half_residual) -
                with_mu * flexibility_.jump(column.half) +
                (own_ - flexibility_.direct()).cwiseProduct(column.before);
  column.loads = flexibility_.modal_loads(half_residual);
  column.y = Vector::Zero(free.size());
  column.a = Vector::Zero(column.loads.size());
  evaluate(column);
  return column;
}

void Newton::evaluate(Column& column) {
  column.phi = system_.forces(column.index, memory_, column.jump, own_) - column.before - column.y;
  column.moved = tangent_system_.moved(column.phi, Vector());
  column.norm = norm(column.phi, column.moved);
}

NewtonOutcome Newton::solve(State& state, double tolerance) {
  return system_.with_all(state, [&](State& all) { return solve_all(all, tolerance); });
}

NewtonOutcome Newton::solve_all(State& state, double tolerance) {
  NewtonOutcome outcome;
  const Index columns = state.data.cols();
  const Index steps = system_.laws().steps();
  scale_ = size_of_forces(state.data, state.traces);
  double stages = 0.0;
  for (Index index = 0; index < columns; ++index) {
    if (index % steps == 0) {
      memory_ = system_.blank();
    }
    Column column = begin(state, index);
    stages += 1.0;
    const bool far = !(column.norm < close * scale_);
    if (far && index % steps > 0) {
      // the answer of the step before, under the loads of this one
      const State own{state.data.col(index), state.traces.col(index)};
      state.data.col(index) = state.data.col(index - 1);
      apply(state, index);
      Column start = begin(state, index);
      stages += 2.0;
      if (start.norm < column.norm) {
        column = std::move(start);
      } else {
        state.data.col(index) = own.data;
        state.traces.col(index) = own.traces;
      }
    }
    // from far, and where the whole of it is not solved at once, from what a few global stages bring
    bool solved = false;
    const Index shortest_start =
        std::clamp(system_.unknowns() / unknowns_per_stage, first_relaxation, last_relaxation);
    const Index first = far && columns > 1 ? shortest_start : 0;
    double target = near;
    for (Index count = first; !solved && count <= last_relaxation;
         count = count == 0 ? shortest_start : 2 * count) {
      if (count > 0) {
        const Index before = subspace_.stages();
        State own{state.data.col(index), state.traces.col(index)};
        subspace_.improve(index, memory_, own, target * subspace_.norm(own.data), count);
        target *= nearer;
        state.data.col(index) = own.data;
        state.traces.col(index) = own.traces;
        column = begin(state, index);
        stages += 1.0 + static_cast<double>(subspace_.stages() - before);
      }
      const double start = column.norm;
      // factorisations of a large zone cost more than global stages: one way at first
      const bool all = shortest_start == first_relaxation || 2 * count > last_relaxation;
      solved = iterate(column, tolerance * scale_, all, outcome.steps);
      if (solved || column.norm < halfway * start) {
        commit(state, column);
        stages += 2.0;
      }
    }
    if (!solved) {
      break;
    }
    system_.advance(index, memory_, column.jump, own_);
    ++outcome.solved;
  }
  outcome.stages = (stages + static_cast<double>(outcome.steps)) / static_cast<double>(columns);
  return outcome;
}

void Newton::commit(State& state, const Column& column) {
  state.data.col(column.index) += column.half + flexibility_.solve(flexibility_.spread(column.y)) +
                                  flexibility_.modal_data(column.a);
  apply(state, column.index);
}

void Newton::apply(State& state, Index index) {
  state.traces.col(index) = system_.traces(state.data.col(index), amplitudes_.col(index));
}

bool Newton::iterate(Column& column, double tolerance, bool all, Index& steps) {
  return attempt(column, tolerance, Way::searched, steps) ||
         (all && (attempt(column, tolerance, Way::whole, steps) ||
                  attempt(column, tolerance, Way::tied, steps)));
}

/// Newton's steps from here, as long as they lead somewhere.
bool Newton::attempt(Column& column, double tolerance, Way way, Index& steps) {
  Column now = column;
  Index since = 0;
  for (Index count = 0; count < most_steps; ++count) {
    // equilibrium of the modes holds from the first step on, and what that changes estimates the error
    if (now.norm <= tolerance && count > 0) {
      column = std::move(now);
      return true;
    }
    Vector jump = now.jump;
    const bool tie = way == Way::tied && count == 0;
    Vector shift = Vector::Zero(now.jump.size());
    if (tie) {  // linearise far in the closed branch
      // by the energies of jumps, as these are lengths or rotations
      const Vector roots = own_.cwiseQuotient(flexibility_.areas()).cwiseSqrt();
      const double far = 10.0 * now.jump.cwiseQuotient(roots).cwiseAbs().maxCoeff();
      for (Index row = 0; row < shift.size(); ++row) {
        if (layout_.first[static_cast<std::size_t>(row)] == row) {
          shift(row) = far * roots(row);
        }
      }
      jump -= shift;
    }
    const Matrix tangent = system_.slopes(now.index, memory_, jump, own_);
    if (tie) {
      now.phi = system_.forces(now.index, memory_, jump, own_) +
                tangent_system_.times(tangent, shift) - now.before - now.y;
      now.moved = tangent_system_.moved(now.phi, Vector());
    }
    Vector dy;
    Vector da;
    if (!step(now, tangent, dy, da)) {
      return false;
    }
    take(now, dy, da, way == Way::searched);
    ++steps;
    if (!std::isfinite(now.norm) || now.norm > growth * std::max(column.norm, tie ? scale_ : 0.0)) {
      return false;
    }
    if (now.norm < better * column.norm || tie) {
      column = now;
      since = 0;
    } else if (++since >= most_idle_steps) {
      // no better: rounding, or in circles
      return column.norm <= std::max(tolerance, rounding_of_forces * scale_);
    }
  }
  return false;
}

void Newton::take(Column& column, const Vector& dy, const Vector& da, bool searched) {
  const Column from = column;
  const Vector change = tangent_system_.moved(dy, da);
  column.norm = std::numeric_limits<double>::infinity();
  for (double share = 1.0; share >= shortest; share *= 0.5) {
    Column trial = from;
    trial.y += share * dy;
    trial.a += share * da;
    trial.jump += share * change;
    evaluate(trial);
    const bool enough = !searched || trial.norm < (1.0 - 0.5 * share) * from.norm;
    if (trial.norm < column.norm || !searched) {
      column = std::move(trial);
    }
    if (enough) {
      return;
    }
  }
}

bool Newton::step(const Column& column, const Matrix& tangent, Vector& dy, Vector& da) {
  // dy = Phi + z,  z = S (M (Phi + z) - G a),  theta a = loads + V^T W E (y + dy)
  const Index n = column.y.size();
  Vector right(n + column.a.size());
  right << TangentSystem::softened * tangent_system_.times(tangent, column.moved),
      column.loads +
          flexibility_.modal_jumps().transpose() *
              flexibility_.areas().cwiseProduct(column.y + column.phi) -
          flexibility_.modal_stiffness().cwiseProduct(column.a);
  Matrix answer = tangent_system_.solve(tangent, right);
  system_.follow_first(answer);
  dy = column.phi + answer.topRows(n);
  da = answer.bottomRows(column.a.size());
  return answer.allFinite();
}

}  // namespace latin::iteration
