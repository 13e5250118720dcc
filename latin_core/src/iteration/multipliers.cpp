#include "latin/iteration/multipliers.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "latin/common/error.hpp"
#include "latin/common/numbers.hpp"
#include "latin/iteration/error_estimate.hpp"

namespace latin::iteration {
namespace {

using substructure::ContactTangent;
using substructure::Tangent;

/// c relative to the softness of the bodies, and what it becomes where rounds converge slowly.
constexpr double first_flexibility = 3e-3;
/// Where Newton's method fails what is loose lands on soft springs first: factors of c from one round to the next. In the
/// first of them all points stick, as if they were pressed together by so many times what anything moves: without
/// friction, of which nothing is known yet, loads along the faces would carry parts away.
constexpr double landing = 1e3;
constexpr double harder = 0.1;
constexpr double pressed = 1e3;
constexpr double slower = 0.1;
constexpr double least_factor = 1e-5;
constexpr Index rounds_between = 8;
/// Changes relative to the displacement of a body: of a Newton step, and of a round.
constexpr double short_step = 1e-12;
constexpr double settled = 1e-10;
constexpr Index most_of_rounding = 3;
constexpr Index most_rounds = 200;
constexpr Index most_newton = 60;
/// Operations that condensing may stand for in all factorisations of a search, where it is not cheap, what all of those
/// on the jumps of contacts may take, and how many there are in any case.
constexpr double bearable_work = 1e11;
constexpr double bearable_of_jumps = 1e12;
constexpr Index least_left = 20;
/// Steps of Newton's method without progress, where there is no potential.
constexpr Index patience = 12;
constexpr double progress = 0.9;
/// A line search ends where the slope has fallen to this.
constexpr double flat = 1e-2;
constexpr double steep_enough = 0.1;
constexpr int most_trials = 80;
constexpr int most_halvings = 10;
constexpr double after_halvings = 0.3;
/// Springs that hold what flies, relative to the search direction.
constexpr std::array<double, 5> holds{Tangent::least_hold, 1e-8, Multipliers::keeping, 1e-4, 1e-2};
/// Rounds with bounds held, at first and at most.
constexpr Index first_wait = 6;
constexpr Index most_wait = 100;
/// How far the bounds follow from one round to the next, and halvings to find where they are that.
constexpr double damping = 0.5;
constexpr int most_bisections = 40;
/// Steps that lead upwards by less are rounding.
constexpr double rounding = 1e-8;
/// Diagonals of the bodies below this fraction of the largest are none.
constexpr double least_diagonal = 1e-12;
/// Slopes that differ by less are symmetric.
constexpr double same = 1e-6;

}  // namespace

bool Multipliers::suits(const substructure::Laws& laws) {
  const Communicator& ranks = laws.structure().communicator();
  return laws.modes() == 1 && ranks.everywhere(!laws.transformed()) && !laws.linear_everywhere() &&
         (!laws.scales_anywhere() || ranks.everywhere(laws.stiffness_is_one())) &&
         Tangent::bearable(laws.structure());
}

Multipliers::Multipliers(const substructure::Laws& laws,
                         std::shared_ptr<const substructure::Joined> known)
    : laws_(laws),
      tangent_(laws.structure(),
               known ? std::move(known) : std::make_shared<const substructure::Joined>(laws)),
      system_(laws, tangent_.shared_joined()),
      remembers_(laws.remembers_anywhere()),
      linear_(system_.linear()) {
  const substructure::Structure& structure = laws.structure();
  areas_.resize(system_.unknowns());
  softness_ = Vector::Zero(system_.unknowns());
  const Vector of_rows =
      structure.weights().cwiseQuotient(structure.trace_metric());  // length^3 / force, about
  const Vector softness = joined().of_rows(of_rows);
  for (std::size_t i = 0; i < linear_.size(); ++i) {
    const substructure::Joined::JoinedInterface& interface = joined().interfaces()[i];
    const auto unknowns = Eigen::seqN(interface.first_unknown, interface.size);
    areas_(unknowns) = interface.weights;
    for (const Index first : interface.rows) {
      softness_(unknowns) = softness_(unknowns).cwiseMax(softness.segment(first, interface.size));
    }
    for (Index k = 0; k < interface.size; ++k) {
      const Index unknown = interface.first_unknown + k;
      if (!linear_[i]) {
        nonlinear_.push_back(unknown);
      }
      if (interface.components == 1) {
        single_.push_back(unknown);  // of points without tangential components
      } else if (k % interface.components == 0) {
        coupled_.emplace_back(unknown, interface.components);
      }
    }
  }
  if (!Tangent::possible(structure) && ContactTangent::pays(tangent_, nonlinear_)) {
    contacts_.emplace(tangent_, nonlinear_);
  }
  // what is free of its own body's stiffness is measured with the stiffest
  const Vector diagonal = tangent_.diagonal();
  const double largest = diagonal.size() > 0 ? diagonal.maxCoeff() : 0.0;
  const double least = largest > 0.0 ? least_diagonal * largest : 1.0;
  scale_ = diagonal.cwiseMax(least).cwiseSqrt().cwiseInverse();
}

void Multipliers::set_flexibility(double factor) {
  factor_ = factor;
  Vector wanted = first_flexibility * softness_;
  // rounds do not converge slowly for linear laws, and a structure with other tangents of theirs is another one
  for (const Index unknown : nonlinear_) {
    wanted(unknown) *= factor;
  }
  flexibility_ = system_.law_flexibility(wanted);
}

bool Multipliers::solve(State& state, Index most) {
  const bool found = system_.with_all(state, [&](State& all) { return solve_columns(all, most); });
  before_last_ = system_.own_state(before_last_);
  const auto bodies = static_cast<Index>(laws_.structure().bodies().size());
  placeless_ = Matrix(placeless_.middleCols(joined().first_body(), bodies));
  return found;
}

bool Multipliers::solve_columns(State& state, Index most) {
  const substructure::Structure& structure = laws_.structure();
  const double each = contacts_ ? contacts_->work() : structure.work().condense;
  const double bearable = contacts_ ? bearable_of_jumps : bearable_work;
  left_ = Tangent::possible(structure)
              ? most
              : std::min(most, static_cast<Index>(bearable / std::max(each, 1.0)) + least_left);
  before_last_ = state;
  placeless_ = Matrix::Zero(state.data.cols(), static_cast<Index>(joined().bodies().size()));
  memory_ = system_.blank();
  Vector carried;
  bool all = true;
  for (column_ = 0; column_ < state.data.cols() && left_ > 0; ++column_) {
    if (column_ % laws_.steps() == 0) {
      memory_ = system_.blank();
    }
    traces_ = state.traces.col(column_);
    jump_ = tangent_.sides() * traces_;
    pull_ =
        tangent_.nodal_of_all(state.data.col(column_) - system_.directions().cwiseProduct(traces_));
    const Matrix free = system_.free_jumps(state.data.col(column_), state.traces.col(column_));
    const Vector force = column_ > 0 && remembers_
                             ? carried
                             : system_.forces(column_, memory_, free.col(0), system_.direct());
    const Index for_landing = left_ / 2;
    left_ -= for_landing;
    bool found = solve_column(force, false);
    left_ += for_landing;
    found = found || solve_column(force, true);
    all = all && found;
    carried = force_;
    find_placeless();
    if (remembers_) {
      system_.advance(column_, memory_, free_jump(), flexibility_);
    }
    write(moved_, force_, state);
    write(moved_before_, force_before_, before_last_);
    if (!found && remembers_) {
      return false;  // the others depend on it
    }
  }
  return all && column_ == state.data.cols();
}

/// A column of a state: displacements since the beginning, and forces.
void Multipliers::write(const Vector& moved, const Vector& force, State& state) const {
  state.traces.col(column_) = traces_ + tangent_.traces() * moved;
  state.data.col(column_) = system_.directions().cwiseProduct(state.traces.col(column_)) -
                            tangent_.sides().transpose() * force;
}

/// @param force to begin with
/// @param lands whether what Newton's method fails at lands on soft springs first
bool Multipliers::solve_column(const Vector& force, bool lands) {
  moved_ = Vector::Zero(pull_.size());
  force_ = force;
  moved_before_ = moved_;
  force_before_ = force_;
  set_flexibility(1.0);
  frozen_.resize(0);
  keeping_ = Vector::Zero(placed().rows());
  keeps_ = false;
  Index wait = first_wait;
  Index frozen_rounds = 0;
  double before_change = std::numeric_limits<double>::infinity();
  Index rounds_of_rounding = 0;
  double change_of_rounding = 0.0;
  Vector moved_there;
  Vector force_there;
  Vector bounds;
  bool landed = !lands;
  bool sticks = false;
  for (Index round = 0; round < most_rounds && left_ > 0; ++round) {
    const Vector before = moved_;
    moved_before_ = moved_;
    force_before_ = force_;
    keep_idle();
    const bool frozen = frozen_rounds > 0;
    if (frozen) {
      const Vector now = free_jump();
      if (sticks) {
        bounds = all_pressed();
      } else if (bounds.size() == 0) {
        bounds = now;
      } else {
        follow(bounds, now);
      }
      frozen_ = bounds;
    } else {
      frozen_.resize(0);
    }
    const bool good = find_equilibrium();
    if (!good && !frozen && (!landed || !coupled_.empty())) {
      moved_ = before;
      frozen_rounds = wait;
      wait = std::min(2 * wait, most_wait);
      if (!landed) {
        landed = true;
        sticks = true;
        set_flexibility(landing);
      }
      continue;
    }
    Vector next = force_at(free_jump());
    if (!next.allFinite()) {
      return false;
    }
    force_ = std::move(next);
    const double now = change(moved_ - before, forceless());
    if (std::exchange(sticks, false)) {
      bounds.resize(0);
    }
    if (factor_ > 1.0) {
      set_flexibility(std::max(harder * factor_, 1.0));
      continue;
    }
    if (good && !loose_ && now < settled) {
      return true;
    }
    if (!good || loose_ || now > of_rounding) {
      rounds_of_rounding = 0;
    } else if (rounds_of_rounding == 0 || now < 0.5 * change_of_rounding) {
      rounds_of_rounding = 1;
      change_of_rounding = now;
      moved_there = moved_before_;
      force_there = force_before_;
    } else if (++rounds_of_rounding > most_of_rounding) {
      // they become no shorter: all of them together are what is not known
      moved_before_ = moved_there;
      force_before_ = force_there;
      return true;
    }
    if (frozen) {
      --frozen_rounds;
    } else if (good && rounds_of_rounding == 0 && round % rounds_between == rounds_between - 1 &&
               now > slower * before_change && factor_ > least_factor) {
      set_flexibility(slower * factor_);
    }
    before_change = now;
  }
  return false;
}

/// The largest displacement of a side.
double Multipliers::farthest() const {
  const Vector traces = traces_ + tangent_.traces() * moved_;
  return traces.cwiseQuotient(joined().levers()).cwiseAbs().maxCoeff();
}

/// Free jumps of points that are pressed together by far.
Vector Multipliers::all_pressed() const {
  Vector jump = free_jump();
  double open = 0.0;
  for (const Index unknown : nonlinear_) {
    open = std::max(open, std::abs(jump(unknown)));
  }
  const double far = pressed * (open + farthest());
  for (const auto& [normal, count] : coupled_) {
    jump(normal) = -far;
  }
  return jump;
}

/// Free jumps whose normal forces are between those of two others.
void Multipliers::follow(Vector& bounds, const Vector& now) const {
  const Vector first = system_.forces(column_, memory_, bounds, flexibility_);
  const Vector last = system_.forces(column_, memory_, now, flexibility_);
  const Vector wanted = first + damping * (last - first);
  Vector low = bounds;
  Vector high = now;
  for (int halving = 0; halving < most_bisections; ++halving) {
    const Vector middle = 0.5 * (low + high);
    const Vector force = system_.forces(column_, memory_, middle, flexibility_);
    for (const auto& [normal, count] : coupled_) {
      const bool below = (force(normal) - wanted(normal)) * (last(normal) - first(normal)) < 0.0;
      (below ? low : high)(normal) = middle(normal);
    }
  }
  bounds = now;
  for (const auto& [normal, count] : coupled_) {
    bounds(normal) = high(normal);
  }
}

Vector Multipliers::free_jump() const {
  return jump_ + tangent_.jumps() * moved_ + flexibility_.cwiseProduct(force_);
}

Vector Multipliers::force_at(const Vector& jump) const {
  Vector force = system_.forces(column_, memory_, jump, flexibility_);
  if (frozen_.size() == 0) {
    return force;
  }
  Vector held = jump;
  for (const auto& [normal, count] : coupled_) {
    held(normal) = frozen_(normal);
  }
  Vector bounded = system_.forces(column_, memory_, held, flexibility_);
  for (const auto& [normal, count] : coupled_) {
    bounded(normal) = force(normal);
  }
  return bounded;
}

Multipliers::Answered Multipliers::ask() const {
  const Vector jump = free_jump();
  Answered at{force_at(jump), system_.slopes(column_, memory_, jump, flexibility_), true};
  if (frozen_.size() > 0) {
    Vector held = jump;
    for (const auto& [normal, count] : coupled_) {
      held(normal) = frozen_(normal);
    }
    Matrix bounded = system_.slopes(column_, memory_, held, flexibility_);
    bounded.col(0).setZero();
    for (const auto& [normal, count] : coupled_) {
      bounded.row(normal) = at.slopes.row(normal);
      bounded.row(normal).tail(bounded.cols() - 1).setZero();
    }
    // points with one component know no friction
    for (const Index unknown : single_) {
      bounded.row(unknown) = at.slopes.row(unknown);
    }
    at.slopes = bounded;
  }
  const double size = at.slopes.cwiseAbs().maxCoeff();
  for (const auto& [first, count] : coupled_) {
    for (Index a = 0; a < count; ++a) {
      at.symmetric = at.symmetric && at.slopes(first + a, a) >= 0.0;
      for (Index b = 0; b < a; ++b) {
        at.symmetric = at.symmetric &&
                       std::abs(at.slopes(first + a, b) - at.slopes(first + b, a)) <= same * size;
      }
    }
  }
  return at;
}

Vector Multipliers::residual_of(const Vector& force) const {
  return tangent_.stiffness_times(moved_) + pull_ +
         tangent_.jumps().transpose() * areas_.cwiseProduct(force) +
         kept_forces(moved_ - moved_before_);
}

/// A step with springs on all bodies. @return whether it leads downwards, where that is known
bool Multipliers::try_step(const Answered& at, const Vector& residual, double hold, Vector& step) {
  try {
    if (contacts_) {
      contacts_->factorise(at.slopes, keeping_.cwiseQuotient(areas_).cwiseMax(
                                          std::max(hold, ContactTangent::least_hold) *
                                          system_.direct().cwiseInverse()));
      step = -contacts_->solve(residual);
    } else {
      tangent_.factorise_stiffness(at.slopes, hold);
      step = -tangent_.solve(residual);
    }
  } catch (const NumericalError&) {
    step = Vector::Zero(residual.size());
    return false;
  }
  return step.allFinite() &&
         (!at.symmetric || step.dot(residual) <= rounding * step.norm() * residual.norm());
}

bool Multipliers::step_from(const Answered& at, const Vector& residual, Vector& step) {
  const double least = keeps_ && !contacts_ ? keeping : holds.front();
  for (const double hold : holds) {
    if (hold < least) {
      continue;
    }
    --left_;
    const bool good = try_step(at, residual, hold, step);
    if (system_.follow_first(good)) {
      system_.follow_first(step);
      held_ = hold > least;
      return true;
    }
  }
  return false;
}

/// Where the energy is least along a step.
double Multipliers::line_search(const Answered& at, const Vector& residual,
                                const Vector& step) const {
  const Vector along = tangent_.jumps() * step;
  const Vector jump = free_jump();
  const double curvature = step.dot(stiffness_times(step));
  const double start = system_.follow_first(step.dot(residual));
  const auto slope_at = [&](double length) {
    const Vector change = force_at(jump + length * along) - at.force;
    return system_.follow_first(along.dot(areas_.cwiseProduct(change)) + length * curvature +
                                start);
  };
  double high_slope = slope_at(1.0);
  if (!(high_slope > steep_enough * std::abs(start))) {
    return 1.0;
  }
  double low = 0.0;
  double high = 1.0;
  double low_slope = start;
  double length = 1.0;
  bool raised = false;
  for (int trial = 0; trial < most_trials; ++trial) {
    length = low - low_slope * (high - low) / (high_slope - low_slope);
    const double slope = slope_at(length);
    if (std::abs(slope) <= flat * std::abs(start)) {
      break;
    }
    // false position, where an end that stays counts half (Illinois): what flies lands far below a whole step
    const bool raises = slope < 0.0;
    if (raises) {
      low = length;
      low_slope = slope;
      high_slope *= trial > 0 && raised ? 0.5 : 1.0;
    } else {
      high = length;
      high_slope = slope;
      low_slope *= trial > 0 && !raised ? 0.5 : 1.0;
    }
    raised = raises;
  }
  return length;
}

/// How far to go along a step; 0 where Newton's method is given up.
double Multipliers::step_length(const Answered& at, const Vector& residual, const Vector& step) {
  if (at.symmetric && system_.follow_first(step.dot(residual)) < 0.0) {
    return line_search(at, residual, step);
  }
  const double base = system_.follow_first(scale_.cwiseProduct(residual).norm());
  if (base < progress * best_) {
    best_ = base;
    since_ = 0;
  } else if (++since_ > patience) {
    return 0.0;
  }
  const Vector along = tangent_.jumps() * step;
  const Vector jump = free_jump();
  const Vector of_bodies = stiffness_times(step);
  double length = 1.0;
  for (int halving = 0; halving < most_halvings; ++halving) {
    const Vector change = force_at(jump + length * along) - at.force;
    const Vector now =
        residual + length * of_bodies + tangent_.jumps().transpose() * areas_.cwiseProduct(change);
    if (system_.follow_first(scale_.cwiseProduct(now).norm()) <= (1.0 - 1e-4 * length) * base) {
      return length;
    }
    length *= 0.5;
  }
  return after_halvings;
}

bool Multipliers::find_equilibrium() {
  best_ = std::numeric_limits<double>::infinity();
  since_ = 0;
  loose_ = false;
  double last = std::numeric_limits<double>::infinity();
  bool whole = false;
  Index steps_of_rounding = 0;
  Vector step;
  for (Index count = 0; count < most_newton && left_ > 0; ++count) {
    const Answered at = ask();
    const Vector residual = residual_of(at.force);
    if (!residual.allFinite()) {
      return false;
    }
    if (!step_from(at, residual, step)) {
      return false;
    }
    const double now = change(step, {});
    if (!held_ && (now < short_step || (now < of_rounding && whole && now > 0.5 * last))) {
      loose_ = false;
      moved_ += step;
      return true;
    }
    const Vector pushed = tangent_.jumps().transpose() * areas_.cwiseProduct(at.force);
    if (!held_ &&
        system_.follow_first(residual.norm() <=
                             rounding_share * (terms().norm() + pull_.norm() + pushed.norm()))) {
      // steps that what is loose takes from here on are rounding; those of others may not be
      loose_ = change(step, forceless()) > of_rounding;
      if (!loose_ || ++steps_of_rounding > most_of_rounding) {
        moved_ += step;
        return true;
      }
    }
    const double length = step_length(at, residual, step);
    if (length == 0.0) {
      return false;
    }
    moved_ += length * step;
    last = now;
    whole = length == 1.0;
  }
  return false;
}

/// The largest change of a body's faces, relative to their displacements.
/// @param apart bodies that do not count; empty: all do
double Multipliers::change(const Vector& step, const std::vector<bool>& apart) const {
  const Vector lengths = joined().levers().cwiseInverse();
  const Vector now = lengths.cwiseProduct(traces_ + tangent_.traces() * moved_);
  const Vector moves = lengths.cwiseProduct(tangent_.traces() * step);
  const double reach = now.cwiseAbs().maxCoeff();
  double worst = 0.0;
  for (std::size_t b = 0; b < joined().bodies().size(); ++b) {
    if (!apart.empty() && apart[b]) {
      continue;
    }
    const auto rows = rows_of(b);
    const double size = std::max(now(rows).norm(), std::numeric_limits<double>::epsilon() * reach);
    const double moved = moves(rows).norm();
    worst = larger(worst, size > 0.0 ? moved / size : moved);
  }
  return system_.follow_first(worst);
}

}  // namespace latin::iteration
