#include "latin/iteration/newton.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "latin/iteration/stages.hpp"
#include "latin/iteration/step.hpp"

namespace latin::iteration {
namespace {

/// Tangents closer than this are the same: they come from differences.
constexpr double same_tangent = 1e-6;
constexpr double with_mu = 1.0 + 2.0 * substructure::Flexibility::mu;
constexpr double modal = with_mu / (1.0 + substructure::Flexibility::mu);
/// Steps without a better residual before another tangent is tried, and a residual that counts as better.
constexpr Index patience = 5;
constexpr double better = 0.7;
/// A residual that grew by so much is not followed.
constexpr double growth = 1e4;
constexpr Index most_steps = 40;
/// Shortest step of the line search.
constexpr double shortest = 0.06;
/// A residual that no step makes better is rounding if it is below this share of the forces.
constexpr double rounding = 1e-9;
/// Share by which the tangents are reduced: forces that the meshes do not determine get a unique, bounded change.
constexpr double softening = 1e-5;
/// A column whose residual is below this share of the forces starts where it is.
constexpr double close = 1e-2;
/// Accelerated steps between two attempts at a column, and their history.
constexpr Index first_relaxation = 6;
constexpr Index last_relaxation = 48;
constexpr Index depth = 10;

}  // namespace

Newton::Newton(substructure::GlobalStage& global, substructure::LocalStage& local,
               const Matrix& amplitudes)
    : global_(global),
      local_(local),
      amplitudes_(amplitudes),
      system_(global.laws()),
      flexibility_(system_.flexibility()),
      layout_(system_.layout()),
      own_(system_.law_flexibility(flexibility_.own())),
      shift_(own_ + flexibility_.direct()),
      metric_(own_.cwiseProduct(flexibility_.areas())),
      zones_(static_cast<std::size_t>(amplitudes.cols())) {}

double Newton::norm(const Vector& force) const { return std::sqrt(force.cwiseAbs2().dot(metric_)); }

Vector Newton::times(const Matrix& tangent, const Vector& p) const {
  Vector result(p.size());
  for (Index row = 0; row < p.size(); ++row) {
    const auto at = static_cast<std::size_t>(row);
    const Index count = layout_.components[at];
    result(row) = tangent.row(row).head(count).dot(p.segment(layout_.first[at], count));
  }
  return result;
}

/// Change of j0 with changes of the forces and of the amplitudes.
Vector Newton::moved(const Vector& y, const Vector& a) const {
  Vector result = shift_.cwiseProduct(y);
  result.noalias() -= with_mu * (flexibility_.matrix() * y);
  result.noalias() -= modal * (flexibility_.modal_jumps() * a);
  return result;
}

Newton::Column Newton::begin(ConstMatrixRef data, ConstMatrixRef traces, Index index) {
  Column column;
  column.index = index;
  // as the iteration sees it: the forces of the laws at the jumps of this iterate
  const Matrix all = system_.free_jumps(data, traces);
  column.before = system_.forces(all, flexibility_.direct()).col(index);
  const Vector free = all.col(index);
  // F / 2 = E f - (s - k w)
  const Vector half_residual =
      flexibility_.spread(column.before) - data.col(index) +
      global_.laws().structure().directions().cwiseProduct(traces.col(index));
  column.half = flexibility_.solve(half_residual);
  column.start = free + flexibility_.jump(2.0 * half_residual) -
                 with_mu * flexibility_.jump(column.half) +
                 (own_ - flexibility_.direct()).cwiseProduct(column.before);
  column.loads = flexibility_.modal_loads(half_residual);
  column.y = Vector::Zero(free.size());
  column.a = Vector::Zero(column.loads.size());
  column.jump = column.start;
  evaluate(column);
  return column;
}

void Newton::evaluate(Column& column) {
  jumps_.col(column.index) = column.jump;
  column.phi = system_.forces(jumps_, own_).col(column.index) - column.before - column.y;
  column.norm = norm(column.phi);
}

NewtonOutcome Newton::solve(Matrix& data, Matrix& traces, double tolerance) {
  NewtonOutcome outcome;
  const Index columns = data.cols();
  const Index steps = global_.laws().steps();
  const Matrix jumps = system_.free_jumps(data, traces);
  const Matrix forces = system_.forces(jumps, flexibility_.direct());
  jumps_ = jumps + (own_ - flexibility_.direct()).asDiagonal() * forces;
  double scale = 0.0;
  for (Index column = 0; column < columns; ++column) {
    scale = std::max(scale, norm(forces.col(column)));
  }
  if (scale == 0.0) {  // all open: the data, as forces
    for (Index column = 0; column < columns; ++column) {
      scale = std::max(scale, norm(flexibility_.force(data.col(column))));
    }
  }
  scale_ = scale;
  double stages = 0.0;
  for (Index index = 0; index < columns; ++index) {
    Column column = begin(data, traces, index);
    stages += 1.0;
    const bool far = !(column.norm < close * scale);
    if (far && index % steps > 0) {
      // the answer of the step before, under the loads of this one
      State other{data, traces};
      other.data.col(index) = data.col(index - 1);
      apply(other.data, other.traces, index);
      Column start = begin(other.data, other.traces, index);
      stages += 2.0;
      if (start.norm < column.norm) {
        data.col(index) = other.data.col(index);
        traces.col(index) = other.traces.col(index);
        column = std::move(start);
      }
    }
    bool solved = false;
    if (far && columns > 1) {
      Anderson history(metric_of(global_.laws().structure()), 1, depth);
      for (Index count = first_relaxation; !solved && count <= last_relaxation; count *= 2) {
        relax(data, traces, index, history, count);
        column = begin(data, traces, index);
        stages += 1.0 + static_cast<double>(count);
        solved = iterate(column, tolerance * scale, outcome.steps);
      }
    } else {
      solved = iterate(column, tolerance * scale, outcome.steps);
    }
    if (!solved) {
      break;
    }
    data.col(index) += column.half + flexibility_.solve(flexibility_.spread(column.y)) +
                       flexibility_.modal_data(column.a);
    apply(data, traces, index);
    stages += 2.0;
    jumps_.col(index) = column.jump;
    ++outcome.solved;
  }
  outcome.stages = (stages + static_cast<double>(outcome.steps)) / static_cast<double>(columns);
  return outcome;
}

void Newton::apply(const Matrix& data, Matrix& traces, Index index) {
  Matrix trace(data.rows(), 1);
  global_.apply(data.col(index), amplitudes_.col(index), trace);
  traces.col(index) = trace;
}

/// Accelerated steps of the two stages, of one column alone.
void Newton::relax(Matrix& data, Matrix& traces, Index index, Anderson& history, Index count) {
  Matrix residuals(data.rows(), data.cols());
  FixedPoint stages{[&](Matrix&, Matrix& column, Matrix& trace) {
                      data.col(index) = column;
                      apply(data, traces, index);
                      trace = traces.col(index);
                    },
                    [&](const Matrix&, const Matrix&, Matrix& residual) {
                      local_.apply(data, traces, residuals);
                      residual = residuals.col(index);
                    },
                    {}};
  const substructure::Laws& laws = global_.laws();
  if (laws.preconditions()) {
    stages.precondition = [&laws](MatrixRef residual) { laws.precondition(residual); };
  }
  State state{data.col(index), traces.col(index)};
  Matrix residual;
  stages.local(state.data, state.traces, residual);
  Stepper stepper(std::move(stages), history, 1.0);
  for (Index i = 0; i < count; ++i) {
    history.fit(residual);
    stepper.step(history.size() > 0 ? Stepper::Kind::accelerated : Stepper::Kind::averaged,
                 {state, residual});
  }
}

bool Newton::iterate(Column& column, double tolerance, Index& steps) {
  return attempt(column, tolerance, Way::searched, steps) ||
         attempt(column, tolerance, Way::whole, steps) ||
         attempt(column, tolerance, Way::tied, steps);
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
    jumps_.col(now.index) = now.jump;
    const bool tie = way == Way::tied && count == 0;
    Vector shift = Vector::Zero(now.jump.size());
    if (tie) {  // linearise far in the closed branch
      const double far = 10.0 * now.jump.cwiseAbs().maxCoeff();
      for (Index row = 0; row < shift.size(); ++row) {
        if (layout_.first[static_cast<std::size_t>(row)] == row) {
          shift(row) = far;
        }
      }
      jumps_.col(now.index) -= shift;
    }
    const Matrix tangent = system_.slopes(jumps_, own_, now.index);
    if (tie) {
      now.phi =
          system_.forces(jumps_, own_).col(now.index) + times(tangent, shift) - now.before - now.y;
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
    } else if (++since >= patience) {
      // no better: rounding, or in circles
      return column.norm <= std::max(tolerance, rounding * scale_);
    }
  }
  return false;
}

void Newton::take(Column& column, const Vector& dy, const Vector& da, bool searched) {
  const Column from = column;
  const Vector change = moved(dy, da);
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
  Zone& zone = zones_[static_cast<std::size_t>(column.index)];
  if (!zone.fits(tangent)) {
    factorise(tangent, zone);
  }
  // dy = Phi + z,  z = S (M (Phi + z) - G a),  theta a = loads + V^T W E (y + dy)
  const Vector none = Vector::Zero(column.a.size());
  const auto closed = static_cast<Index>(zone.rows.size());
  Vector right(closed + none.size());
  const Vector free = moved(column.phi, none);
  right << ((1.0 - softening) * times(tangent, free))(zone.rows),
      column.loads +
          flexibility_.modal_jumps().transpose() *
              flexibility_.areas().cwiseProduct(column.y + column.phi) -
          flexibility_.modal_stiffness().cwiseProduct(column.a);
  Vector answer = right.size() > 0 ? Vector(zone.lu.transpose().solve(right)) : right;
  if (closed > 0) {
    // forces that move nothing were divided by the softening alone, rounding and all: with K the system
    // without it, K_eps^-1 K leaves them out and everything else as it is
    Vector forces = Vector::Zero(column.y.size());
    forces(zone.rows) = answer.head(closed);
    right.head(closed) -=
        softening * times(tangent, moved(forces, answer.tail(none.size())))(zone.rows);
    answer = zone.lu.transpose().solve(right);
  }
  dy = column.phi;
  dy(zone.rows) += answer.head(closed);
  da = answer.tail(none.size());
  return answer.allFinite();
}

bool Newton::Zone::fits(const Matrix& now) const {
  return tangent.size() == now.size() &&
         (tangent - now).cwiseAbs().maxCoeff() <= same_tangent * now.cwiseAbs().maxCoeff();
}

void Newton::factorise(const Matrix& tangent, Zone& zone) const {
  zone.tangent = tangent;
  zone.rows.clear();
  for (Index unknown = 0; unknown < tangent.rows(); ++unknown) {
    if ((tangent.row(unknown).array() != 0.0).any()) {
      zone.rows.push_back(unknown);
    }
  }
  const auto closed = static_cast<Index>(zone.rows.size());
  const Index modes = flexibility_.modal_stiffness().size();
  const Matrix& matrix = flexibility_.matrix();
  const Vector& areas = flexibility_.areas();
  const Matrix& jumps = flexibility_.modal_jumps();
  // transposed, so that rows of the (symmetric but for the areas) flexibility are read as columns
  Matrix system = Matrix::Zero(closed + modes, closed + modes);
  for (Index i = 0; i < closed; ++i) {
    const Index row = zone.rows[static_cast<std::size_t>(i)];
    const Index first = layout_.first[static_cast<std::size_t>(row)];
    for (Index c = 0; c < layout_.components[static_cast<std::size_t>(row)]; ++c) {
      const double slope = (1.0 - softening) * tangent(row, c);
      if (slope == 0.0) {
        continue;
      }
      const Index at = first + c;
      const double factor = slope * with_mu / areas(at);
      for (Index j = 0; j < closed; ++j) {
        const Index other = zone.rows[static_cast<std::size_t>(j)];
        system(j, i) += factor * areas(other) * matrix(other, at);
        if (other == at) {
          system(j, i) -= slope * shift_(at);
        }
      }
      system.col(i).tail(modes) += slope * modal * jumps.row(at).transpose();
    }
    system(i, i) += 1.0;
    // V^T W E
    system.row(i).tail(modes) = -areas(row) * jumps.row(row);
  }
  system.bottomRightCorner(modes, modes) = flexibility_.modal_stiffness().asDiagonal();
  if (system.size() > 0) {
    zone.lu.compute(system);
  }
}

}  // namespace latin::iteration
