#include "latin/iteration/subspace.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "latin/common/threads.hpp"

namespace latin::iteration {
namespace {

using Memory = JoinedSystem::Memory;

/// Directions that stay when there are too many.
constexpr Index kept = 60;
/// Steps of Gauss and Newton between two directions, and the least that one has to bring.
constexpr Index most_subspace_steps = 20;
constexpr double enough = 0.5;
/// Shortest step of the line search.
constexpr double shortest_step = 0.01;
/// Ridge of the normal equations, relative to their mean.
constexpr double ridge = 1e-13;
/// A direction of which so little is left beside the others is none.
constexpr double dependent_column = 1e-6;
/// A column whose residual is below this share of the data starts where it is.
constexpr double close_residual = 1e-2;
/// What a call leaves of a residual, so that its change says what the error was; and what cannot fall.
constexpr double better_residual = 0.3;
constexpr double rounding_of_residuals = 1e-12;
/// Directions for one column, in one call.
constexpr Index most_stages = 150;
/// Directions whose changes one thread finds.
constexpr Index directions_of_piece = 8;

}  // namespace

Subspace::Subspace(const JoinedSystem& system)
    : system_(system), weights_(system.weights().cwiseQuotient(system.directions())) {
  for (const auto& body : system.joined().bodies()) {
    if (body.traces.rows() > 0) {
      bodies_.emplace_back(body.first_row, body.traces.rows());
    }
  }
}

Subspace::Point Subspace::at(Index column, const Memory& before, State state) const {
  Point point;
  point.jump = system_.free_jumps(state.data, state.traces);
  const Matrix force = system_.forces(column, before, point.jump.col(0), system_.direct());
  point.residual = system_.residual(force, state.data, state.traces);
  point.norm = norm(point.residual);
  point.state = std::move(state);
  return point;
}

double Subspace::norm(ConstMatrixRef block) const {
  return system_.follow_first(std::sqrt((block.cwiseAbs2().transpose() * weights_).sum()));
}

double Subspace::residual_norm(Index column, const Memory& before, const State& state) const {
  return at(column, before, state).norm;
}

bool Subspace::improve(Index column, const Memory& before, State& state, double tolerance,
                       Index most) {
  Point point = at(column, before, std::move(state));
  const Index end = stages_ + most;
  for (;;) {
    for (Index count = 0; count < most_subspace_steps && size_ > 0 && point.norm > tolerance;
         ++count) {
      if (!step(column, before, point)) {
        break;
      }
    }
    if (point.norm <= tolerance || stages_ >= end || !std::isfinite(point.norm)) {
      break;
    }
    Matrix direction = point.residual;
    system_.precondition(direction);
    if (!grow(direction.col(0))) {
      break;
    }
  }
  state = std::move(point.state);
  return point.norm <= tolerance;
}

bool Subspace::step(Index column, const Memory& before, Point& point) {
  const auto data = data_.leftCols(size_);
  const auto traces = traces_.leftCols(size_);
  const Matrix tangent = system_.slopes(column, before, point.jump.col(0), system_.direct());
  const auto& layout = system_.layout();
  const Vector roots = weights_.cwiseSqrt();
  Matrix change(data.rows(), size_);
  in_pieces(size_, directions_of_piece, 4 * data.rows(), [&](Index first, Index directions) {
    const auto own_data = data.middleCols(first, directions);
    const auto own_traces = traces.middleCols(first, directions);
    const Matrix jumps = system_.free_jumps(own_data, own_traces);
    Matrix forces(jumps.rows(), directions);
    for (Index row = 0; row < jumps.rows(); ++row) {
      const auto i = static_cast<std::size_t>(row);
      const Index count = layout.components[i];
      forces.row(row).noalias() =
          tangent.row(row).head(count) * jumps.middleRows(layout.first[i], count);
    }
    change.middleCols(first, directions) =
        roots.asDiagonal() * system_.residual(forces, own_data, own_traces);
  });
  ++steps_;
  Matrix normal = Matrix::Zero(size_, size_);
  normal.selfadjointView<Eigen::Lower>().rankUpdate(change.transpose());
  normal.diagonal().array() += ridge * normal.trace() / static_cast<double>(size_);
  const Vector right = change.transpose() * roots.cwiseProduct(point.residual);
  Matrix shares = -normal.selfadjointView<Eigen::Lower>().ldlt().solve(right);
  system_.follow_first(shares);
  if (!shares.allFinite()) {
    return false;
  }
  const Matrix to_data = data * shares;
  const Matrix to_traces = traces * shares;
  const double norm = point.norm;
  Point best;
  best.norm = norm;
  for (double share = 1.0; share >= shortest_step; share *= 0.5) {
    Point trial = at(column, before,
                     {point.state.data + share * to_data, point.state.traces + share * to_traces});
    if (trial.norm < best.norm) {
      best = std::move(trial);
    } else if (best.norm < norm) {
      break;
    }
    if (best.norm < (1.0 - 0.5 * share) * norm) {
      break;
    }
  }
  if (best.norm < norm) {
    point = std::move(best);
  }
  return point.norm < enough * norm;
}

bool Subspace::grow(const Vector& direction) {
  const Index rows = direction.size();
  if (data_.size() == 0) {
    data_.resize(rows, most_directions);
    traces_.resize(rows, most_directions);
  }
  Matrix data = direction / norm(direction);
  Matrix traces = system_.traces(data, Matrix::Zero(system_.laws().structure().loads(), 1));
  ++stages_;
  if (system_.balances()) {
    system_.balance(data, traces);
    return add(std::move(data), std::move(traces));
  }
  bool grown = false;
  for (const auto& [first, count] : bodies_) {
    Matrix d = Matrix::Zero(rows, 1);
    Matrix t = Matrix::Zero(rows, 1);
    d.middleRows(first, count) = data.middleRows(first, count);
    t.middleRows(first, count) = traces.middleRows(first, count);
    grown = add(std::move(d), std::move(t)) || grown;
  }
  return grown;
}

bool Subspace::add(Matrix data, Matrix traces) {
  if (size_ == most_directions) {
    data_.leftCols(kept) = Matrix(data_.rightCols(kept));
    traces_.leftCols(kept) = Matrix(traces_.rightCols(kept));
    size_ = kept;
  }
  const double before = norm(data);
  for (int twice = 0; twice < 2; ++twice) {
    const Vector along = data_.leftCols(size_).transpose() * weights_.cwiseProduct(data.col(0));
    data.col(0) -= data_.leftCols(size_) * along;
    traces.col(0) -= traces_.leftCols(size_) * along;
  }
  const double left = norm(data);
  if (!(left > dependent_column * before)) {
    return false;
  }
  data_.col(size_) = data.col(0) / left;
  traces_.col(size_) = traces.col(0) / left;
  ++size_;
  return true;
}

NewtonOutcome Subspace::solve(State& state, const Matrix& amplitudes, double tolerance) {
  return system_.with_all(state, [&](State& all) { return solve_all(all, amplitudes, tolerance); });
}

NewtonOutcome Subspace::solve_all(State& state, const Matrix& amplitudes, double tolerance) {
  NewtonOutcome outcome;
  const Index columns = state.data.cols();
  const Index per_history = system_.laws().steps();
  const Index stages_before = stages_;
  const Index steps_before = steps_;
  double scale = 0.0;
  for (Index column = 0; column < columns; ++column) {
    scale = std::max(scale, norm(state.data.col(column)));
  }
  Index other = 0;  // stages beside those of the directions
  Memory memory;
  const auto under_loads = [&](Index column, const Matrix& data) {
    ++other;
    return State{data, system_.traces(data, amplitudes.col(column))};
  };
  for (Index column = 0; column < columns; ++column) {
    if (column % per_history == 0) {
      memory = system_.blank();
    }
    State own{state.data.col(column), state.traces.col(column)};
    double start = residual_norm(column, memory, own);
    if (column % per_history > 0 && start > close_residual * scale) {
      // the answer of the step before, under the loads of this one
      State next = under_loads(column, state.data.col(column - 1));
      if (const double norm = residual_norm(column, memory, next); norm < start) {
        own = std::move(next);
        start = norm;
      }
    }
    const double wanted = std::max(std::min(tolerance * scale, better_residual * start),
                                   rounding_of_residuals * scale);
    const bool solved = improve(column, memory, own, wanted, most_stages);
    own = under_loads(column, own.data);
    state.data.col(column) = own.data;
    state.traces.col(column) = own.traces;
    if (!solved) {
      break;
    }
    const Matrix jump = system_.free_jumps(own.data, own.traces);
    system_.advance(column, memory, jump.col(0), system_.direct());
    ++outcome.solved;
  }
  outcome.steps = steps_ - steps_before;
  outcome.stages =
      static_cast<double>(stages_ - stages_before + other) / static_cast<double>(columns);
  return outcome;
}

}  // namespace latin::iteration
