#include "iteration/newton.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "iteration/dense_skeleton.hpp"
#include "iteration/sparse_skeleton.hpp"
#include "latin/common/error.hpp"

namespace latin::iteration {
namespace {

constexpr Index most_steps = 40;
/// The same where steps are shortened, and the shortest of them.
constexpr Index most_searched = 60;
constexpr double shortest = 0.01;
/// What a step that is shortened has to make the residual fall by, relative to its share.
constexpr double enough = 0.1;
/// An answer is looked at so often again.
constexpr int most_looks = 2;
/// A residual that comes back to these digits so often goes in circles.
constexpr double digits = 1e3;
constexpr int most_returns = 3;
/// What is further away than so many times what the jumps, the gaps and the loads are large has met all that it could.
constexpr double farthest = 10.0;
/// Forces that differ by less, relative to those of the history, are those of one answer.
constexpr double same_answer = 1e-6;
/// A column whose residual is below this share of the forces starts where it is.
constexpr double close = 1e-2;
/// Compliances in series with the laws, relative to the flexibility at which these are asked: at first, how much softer
/// where steps do not arrive and how much stiffer where they do, the softest, and how many are tried.
constexpr double first_softness = 1.0;
constexpr double softer = 10.0;
constexpr double less_soft = 0.5;
constexpr double most_softness = 1e6;
constexpr Index most_rounds = 12;
/// Springs on the modes, relative to the search direction: the first, how much weaker the next is, and the last.
constexpr double first_spring = 0.1;
constexpr double weaker = 0.1;
constexpr double last_spring = 1e-9;
/// Springs that are no weak ones any more.
constexpr double stiff = 1e3;
/// Springs weaker than this that carry no less than this share of what they did when they were as much stronger hold
/// what slides away; what they carry is rounding below that share of the forces.
constexpr double weak_spring = 1e-4;
constexpr double constant_share = 0.5;
constexpr double carries_nothing = 1e-6;

}  // namespace

Newton::Newton(substructure::GlobalStage& global, const Matrix& amplitudes, bool dense,
               std::function<bool(Index)> goes_on, Balanced balanced)
    : amplitudes_(amplitudes),
      system_(global),
      memory_(system_.blank()),
      goes_on_(std::move(goes_on)),
      balanced_(std::move(balanced)) {
  if (dense) {
    skeleton_ = std::make_unique<DenseSkeleton>(system_);
  } else {
    skeleton_ = std::make_unique<SparseSkeleton>(system_);
  }
  own_ = skeleton_->own();
  roots_ = own_.cwiseQuotient(skeleton_->areas()).cwiseSqrt();
  lengths_ = reach(system_.lengths());
  remembers_ = system_.laws().remembers_anywhere();
  softening_ = system_.softening().cwiseProduct(skeleton_->areas());
  softens_ = system_.follow_first(softening_.size() > 0 && softening_.maxCoeff() > 0.0);
}

/// What the loads of a column alone leave out of balance.
Vector Newton::loads_of(Index index) const {
  const Vector none = Vector::Zero(system_.directions().size());
  return started(index, Vector::Zero(own_.size()), none,
                 system_.traces(none, amplitudes_.col(index)).col(0))
      .start.loads;
}

/// Jumps that the loads alone leave, where no interface pushes and nothing moves as a whole.
double Newton::reach_of_loads(const State& state) {
  State none{Matrix::Zero(state.data.rows(), state.data.cols()), state.traces};
  double farthest_jump = 0.0;
  for (Index index = 0; index < state.data.cols(); ++index) {
    apply(none, index);
    const Column column = begin(none, index);
    farthest_jump = std::max(
        {farthest_jump, reach(column.jump), reach(column.jump - own_.cwiseProduct(column.before))});
  }
  return farthest_jump;
}

double Newton::size_of_forces(const Matrix& data, const Matrix& traces) const {
  double size = 0.0;
  const auto grow = [&](const Vector& force) { size = std::max(size, skeleton_->size_of(force)); };
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
      grow(-system_.jumps(data.col(index).cwiseQuotient(system_.directions()))
                .col(0)
                .cwiseQuotient(system_.direct()));
    }
  }
  if (size == 0.0) {  // nothing yet: the loads
    for (Index index = 0; index < data.cols(); ++index) {
      size = std::max(size, skeleton_->size_of_imbalance(loads_of(index)));
    }
  }
  return size;
}

Newton::Column Newton::begin(const State& state, Index index) {
  // as the iteration sees it: the forces of the laws at the jumps of this iterate
  const auto data = state.data.col(index);
  const auto traces = state.traces.col(index);
  const Matrix free = system_.free_jumps(data, traces);
  Column column =
      started(index, system_.forces(index, memory_, free.col(0), system_.direct()), data, traces);
  evaluate(column);
  return column;
}

Newton::Column Newton::started(Index index, const Vector& force, ConstVectorRef data,
                               ConstVectorRef traces) const {
  Column column;
  column.index = index;
  column.before = force;
  const Vector unbalanced = 0.5 * system_.residual(force, data, traces);
  column.jump = system_.jumps(traces) + own_.cwiseProduct(force);
  column.start = skeleton_->begin(unbalanced, column.jump);
  column.y = column.stretching = Vector::Zero(force.size());
  column.motion = Vector::Zero(skeleton_->motions());
  return column;
}

Vector Newton::forces(const Column& column) const {
  return system_.forces(column.index, memory_, stretched(column), (1.0 + column.softness) * own_);
}

Matrix Newton::slopes(const Column& column) const {
  return system_.slopes(column.index, memory_, stretched(column), (1.0 + column.softness) * own_);
}

void Newton::evaluate(Column& column) {
  column.phi = forces(column) - column.before - column.y;
  column.norm = std::hypot(skeleton_->size_of(column.phi),
                           system_.follow_first(skeleton_->size_of_imbalance(imbalance(column))));
}

NewtonOutcome Newton::solve(State& state, double tolerance, Index most) {
  return system_.with_all(state, [&](State& all) { return solve_all(all, tolerance, most); });
}

NewtonOutcome Newton::solve_all(State& state, double tolerance, Index most) {
  NewtonOutcome outcome;
  const Index columns = std::min(most, state.data.cols());
  lost_.reset();
  hangs_on_nothing_ = false;
  asked_ = -1;
  stopped_ = false;
  scale_ = size_of_forces(state.data, state.traces);
  memory_ = system_.blank();
  far_ = std::max(lengths_, reach_of_loads(state));
  double stages = 0.0;
  outcome.falls = Vector::Zero(state.data.cols());
  for (Index index = 0; index < columns; ++index) {
    if (index % system_.laws().steps() == 0) {
      memory_ = system_.blank();
      last_ = {Vector::Zero(system_.unknowns()), Vector::Zero(system_.unknowns()), {}};
    }
    Column column = begin(state, index);
    stages += 3.0;
    fall_ = 0.0;
    if (!solve_column(state, column, tolerance, outcome.steps)) {
      if (state.data.cols() == system_.laws().steps()) {
        outcome.lost = lost_;
      }
      break;
    }
    last_ = {column.force(), column.jump, {}};
    scale_ = std::max(scale_, skeleton_->size_of(last_.force));
    system_.advance(index, memory_, column.jump, own_);
    outcome.falls(index) = fall_;
    ++outcome.solved;
  }
  outcome.hangs_on_nothing = hangs_on_nothing_;
  outcome.stages = (stages + static_cast<double>(outcome.steps)) / static_cast<double>(columns);
  return outcome;
}

bool Newton::solve_column(State& state, Column& column, double tolerance, Index& steps) {
  const Index index = column.index;
  const bool later = index % system_.laws().steps() > 0;
  // of a step that nobody has looked at nothing is known (that zero answers its loads is not the way of the history),
  // nor of one that has flown away
  const bool near = system_.follow_first(column.norm < close * scale_);
  const bool known =
      system_.follow_first(!(later && remembers_) || !state.data.col(index).isZero(0.0)) &&
      (!gone(column) || (near && hangs(column, loads_of(index))));
  if (known && near && attempt(column, tolerance, {}, steps)) {
    commit(state, column);
    return true;
  }
  const State own{state.data.col(index), state.traces.col(index)};
  const Column of_own = column;
  if (later || !known) {
    if (later) {
      state.data.col(index) = state.data.col(index - 1);
    } else {
      state.data.col(index).setZero();
    }
    apply(state, index);
    column = begin(state, index);
  }
  const bool found = march(state, column, tolerance, steps);
  const bool same = found && !known && of_own.norm <= tolerance * scale_ &&
                    skeleton_->size_of(column.force() - of_own.force()) <= same_answer * scale_;
  if ((found || lost_) && !same) {
    commit(state, column);
    if (found && softens_) {  // a long way has left its rounding, and is not gone again
      refine(state, column, tolerance, steps);
    }
  } else {
    // that it was there is found again, but for rounding
    state.data.col(index) = own.data;
    state.traces.col(index) = own.traces;
    column = same ? of_own : column;
  }
  return found;
}

void Newton::refine(State& state, Column& column, double tolerance, Index& steps) {
  for (int round = 0; round < most_looks; ++round) {
    Column again = begin(state, column.index);
    if (again.norm <= tolerance * scale_ || !attempt(again, tolerance, {}, steps)) {
      return;
    }
    column = again;
    commit(state, column);
  }
}

/// From the answer of the step before.
bool Newton::march(const State& state, Column& column, double tolerance, Index& steps) {
  last_.slopes = system_.slopes(column.index, memory_, last_.jump, own_);
  if (softens_) {  // an equilibrium that is not on their path is no answer
    return follow(state, column, tolerance, steps);
  }
  const Column start = column;
  for (const Way way : {Way{&last_, false}, Way{&last_, true}, Way{nullptr, true}}) {
    column = start;
    if (attempt(column, tolerance, way, steps)) {
      if (!gone(column) || hangs(column, column.start.loads)) {
        return true;
      }
      break;  // rounding holds it there
    }
    if (lost_) {
      break;
    }
  }
  column = start;
  if (unbalanced(column)) {
    return false;
  }
  if (drift(column, tolerance, steps) || lost_) {
    return !lost_;
  }
  column = start;
  if (soften(column, tolerance, steps) && (!gone(column) || hangs(column, column.start.loads))) {
    return true;
  }
  column = start;
  return in_parts(state, column, tolerance, steps);
}

void Newton::commit(State& state, const Column& column) {
  state.data.col(column.index) =
      skeleton_->data(state.data.col(column.index), state.traces.col(column.index), column.start,
                      column.force(), column.y, column.motion);
  apply(state, column.index);
}

void Newton::apply(State& state, Index index) {
  state.traces.col(index) = system_.traces(state.data.col(index), amplitudes_.col(index));
}

/// Newton's steps from here, until they arrive or go in circles.
bool Newton::attempt(Column& column, double tolerance, Way way, Index& steps) {
  // a step moves what hangs on nothing no further: it may touch something on the way
  const double far = std::max(far_, reach(last_.jump));
  const Index most = way.searched ? most_searched : most_steps;
  const auto& layout = system_.layout();
  skeleton_->exactly(way.searched);
  std::map<long, int> seen;
  double share = 0.0;
  double before = 0.0;
  for (Index count = 0; count < most; ++count) {
    const double size = std::max(scale_, skeleton_->size_of(column.force()));
    if (count > 0 && share == 1.0 && column.norm <= tolerance * size) {
      return true;
    }
    if (!std::isfinite(column.norm)) {
      return false;
    }
    if (share == 1.0 && column.norm <= rounding_of_forces * size && 2.0 * column.norm > before) {
      return true;
    }
    if (column.norm > 0.0 &&
        ++seen[std::lround(digits * std::log10(column.norm))] >= most_returns) {
      return false;
    }
    before = column.norm;
    const bool predicted = count == 0 && way.predictor != nullptr;
    Matrix tangent;
    if (predicted) {
      tangent = way.predictor->slopes;
      column.phi =
          way.predictor->force +
          times(tangent, layout.first, layout.components, column.jump - way.predictor->jump) -
          column.force();
    } else {
      tangent = slopes(column);
    }
    stopped_ = stopped_ || (goes_on_ && !goes_on_(steps));
    Step step;
    if (stopped_ || !skeleton_->step(tangent, column.phi, imbalance(column), step.dy, step.dm)) {
      return false;
    }
    ++steps;
    if (count == 0 && !predicted && !stay(column, tangent, tolerance, step, steps)) {
      return column.norm <= tolerance * size;
    }
    step.change = skeleton_->moved(step.dy, step.dm);
    const double moves = reach(step.change - own_.cwiseProduct(step.dy));
    const bool flies =
        system_.follow_first(far > 0.0 && moves > far && skeleton_->loose(step.dm, size));
    if (flies && unbalanced(column)) {
      return false;
    }
    share = flies ? step_on_springs(column, tangent, far, step, steps) : 1.0;
    share = take(column, step, share, way.searched && !predicted);
  }
  return false;
}

/// A step in place of one that moves what hangs on nothing. Any place of that is an answer: springs keep it where it is
/// that are as weak as rounding lets them be.
/// @return whether there is one
bool Newton::stay(const Column& column, const Matrix& tangent, double tolerance, Step& step,
                  Index& steps) {
  if (!system_.follow_first(skeleton_->loose(step.dm, column.norm))) {
    return true;
  }
  hangs_on_nothing_ = true;
  const double held =
      skeleton_->hold(std::max(last_spring, std::numeric_limits<double>::epsilon() / tolerance));
  const bool answers = skeleton_->step(tangent, column.phi, imbalance(column), step.dy, step.dm);
  skeleton_->hold(held);
  ++steps;
  return answers;
}

/// A step in place of one that moves what nothing holds too far: with springs from here, as stiff as that needs.
/// @return the share of it that goes no further than `far`
double Newton::step_on_springs(const Column& column, const Matrix& tangent, double far, Step& step,
                               Index& steps) {
  const double held = skeleton_->hold(0.0);
  const Vector loads = imbalance(column);
  const auto moves = [&] {
    return system_.follow_first(reach(step.change - own_.cwiseProduct(step.dy)));
  };
  double further = moves() / far;
  for (double spring = std::max(last_spring, held / weaker); further > 1.0 && spring < stiff;
       spring *= std::max(1.0 / weaker, further)) {
    skeleton_->hold(spring);
    if (!skeleton_->step(tangent, column.phi, loads, step.dy, step.dm)) {
      break;
    }
    ++steps;
    step.change = skeleton_->moved(step.dy, step.dm);
    further = moves() / far;
  }
  skeleton_->hold(held);
  return 1.0 / std::max(1.0, further);
}

/// With a compliance in series with every law, which the forces of the round before have stretched already: the proximal
/// point method (R. T. Rockafellar, SIAM J. Control Optim. 14 (1976) 877). Soft enough, steps arrive; rounds lead to the
/// answer, near which steps arrive without it. A law with a compliance is that law at a larger flexibility.
bool Newton::soften(Column& column, double tolerance, Index& steps) {
  double softness = first_softness;
  Index next_trial = 1;
  for (Index round = 0; round < most_rounds && softness < most_softness && !stopped_; ++round) {
    Column next = column;
    next.softness = softness;
    next.stretching = column.force();
    evaluate(next);
    if (!attempt(next, tolerance, {nullptr, true}, steps)) {
      softness *= softer;
      continue;
    }
    softness *= less_soft;
    next.softness = 0.0;
    evaluate(next);
    column = next;
    if (round >= next_trial) {
      next_trial = 2 * round;
      if (attempt(next, tolerance, {}, steps)) {
        column = next;
        return true;
      }
    }
  }
  return false;
}

/// Whether it is further away than all that it could meet.
bool Newton::gone(const Column& column) const {
  return system_.follow_first(reach(column.jump) > farthest * std::max(far_, reach(last_.jump)));
}

/// Whether nothing can balance the loads of a column.
bool Newton::unbalanced(const Column& column) {
  if (balanced_ && asked_ != column.index) {
    asked_ = column.index;
    if (!balanced_(column.index)) {
      lost_ = Status::no_equilibrium;
    }
  }
  return lost_ == Status::no_equilibrium;
}

/// The modes on springs that hold them where the column began, ever weaker: at an equilibrium they carry nothing in the
/// end.
bool Newton::drift(Column& column, double tolerance, Index& steps) {
  if (!skeleton_->moves()) {
    return false;
  }
  std::vector<double> carried;
  double before = 0.0;
  bool found = true;
  for (double spring = first_spring; found && spring >= last_spring; spring *= weaker) {
    skeleton_->hold(spring);
    found = settle(column, before > 0.0 ? before / spring : 1.0, tolerance, steps);
    before = spring;
    carried.push_back(system_.follow_first(skeleton_->held(column.motion)));
    const double size = std::max(scale_, skeleton_->size_of(column.force()));
    if (found && gone(column) && spring < weak_spring && carried.back() > carries_nothing * size &&
        carried.back() > constant_share * carried[carried.size() - 2]) {
      skeleton_->hold(0.0);
      if (!hangs(column, imbalance(column))) {
        lost_ = Status::slides;
      }
      break;
    }
  }
  skeleton_->hold(0.0);
  evaluate(column);
  return found && !lost_ &&
         (attempt(column, tolerance, {}, steps) ||
          attempt(column, tolerance, {nullptr, true}, steps));
}

/// Whether something holds what these loads pull at, however soft it is.
bool Newton::hangs(const Column& column, const Vector& loads) {
  Vector dy;
  Vector dm;
  bool answers = false;
  try {
    answers = skeleton_->step(slopes(column), Vector::Zero(own_.size()), loads, dy, dm);
  } catch (const NumericalError&) {
    answers = false;  // the matrix is singular: nothing does
  }
  return system_.follow_first(answers &&
                              !skeleton_->loose(dm, skeleton_->size_of_imbalance(loads)));
}

/// With springs on the modes, from where springs so many times as strong have left the column.
bool Newton::settle(Column& column, double ratio, double tolerance, Index& steps) {
  std::vector<Column> starts{column};
  if (ratio > 1.0) {
    // what hangs on a spring alone goes as much further as that is weaker
    const Vector further = skeleton_->further(column.motion, ratio);
    if (further.size() > 0) {
      starts.insert(starts.begin(), column);
      starts.front().motion += further;
      starts.front().jump += skeleton_->moved(Vector::Zero(column.y.size()), further);
    }
  }
  for (Column& start : starts) {
    evaluate(start);
  }
  std::ranges::stable_sort(starts, {}, &Column::norm);
  for (Column& start : starts) {
    for (const bool searched : {false, true}) {
      Column trial = start;
      if (attempt(trial, tolerance, {nullptr, searched}, steps)) {
        column = std::move(trial);
        return true;
      }
    }
  }
  return false;
}

double Newton::take(Column& column, const Step& step, double share, bool searched) {
  const Column from = column;
  const auto go = [&](double length) {
    column = from;
    column.y += length * step.dy;
    column.motion += length * step.dm;
    column.jump += length * step.change;
    evaluate(column);
  };
  if (!searched) {
    go(share);
    return share;
  }
  double best = share;
  double least = std::numeric_limits<double>::infinity();
  for (double length = share; length > shortest * share; length *= 0.5) {
    go(length);
    if (column.norm < least) {
      least = column.norm;
      best = length;
    }
    if (column.norm < (1.0 - enough * length) * from.norm) {
      return length;
    }
  }
  go(best);
  return best;
}

}  // namespace latin::iteration
