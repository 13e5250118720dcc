#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/numbers.hpp"
#include "iteration/newton.hpp"
#include "latin/common/error.hpp"

namespace latin::iteration {
namespace {

/// Steps of Newton's with the load as an unknown, and parts of the path of a column.
constexpr Index most_corrections = 10;
constexpr Index most_parts = 20000;
/// An increment is to damage as much as one point that breaks, or this share of all that are damaged, and may exceed that.
constexpr double share_of_damaged = 0.1;
constexpr double exceeded = 1.25;
/// From one increment to the next; one that fails is made smaller.
constexpr double largest_growth = 4.0;
constexpr double smaller_by = 0.5;
/// A point is damaged if it loses more of its stiffness than this.
constexpr double damaged_by = 1e-6;
/// Integrity of a point is known to this.
constexpr double of_a_point = 1e-3;
/// The last that is tried, relative to the first.
constexpr double least_share = 1e-6;
/// Jumps are opened by this share to see what bonds at their threshold do when they are damaged.
constexpr double onwards = 1e-6;
/// The shortest part of a step of loads that is tried where the whole step is not followed.
constexpr double shortest_part = 1.0 / 32.0;
/// A load is known to this share of what is left.
constexpr double of_load = 1e-12;
/// What is to be dissipated counts by this share beside the forces.
constexpr double accuracy_of_amount = 1e-3;

}  // namespace

void Newton::load(Course& course, Column& column, double more) {
  course.load += more;
  column.jump += more * course.jump;
  column.start.answer += more * course.start.answer;
  column.start.loads += more * course.start.loads;
}

JoinedSystem::Memory Newton::after(const Column& column) const {
  JoinedSystem::Memory memory = memory_;
  system_.advance(column.index, memory, column.jump, own_);
  return memory;
}

/// The loads of the step before and of this one, and the state between them.
Newton::Course Newton::course_of(const State& state, Column& column) {
  const Index index = column.index;
  Vector before = Vector::Zero(amplitudes_.rows());
  if (index % system_.laws().steps() > 0) {
    before = amplitudes_.col(index - 1);
  }
  const Matrix data = state.data.col(index);
  const Column end = started(index, last_.force, data.col(0), state.traces.col(index));
  column = started(index, last_.force, data.col(0), system_.traces(data, before).col(0));
  evaluate(column);
  return {{end.start.answer - column.start.answer, end.start.loads - column.start.loads},
          end.jump - column.jump,
          before,
          amplitudes_.col(index) - before,
          {}};
}

/// With loads that grow from those of the step before, by as much as Newton's steps follow.
bool Newton::in_parts(const State& state, Column& column, double tolerance, Index& steps) {
  const JoinedSystem::Memory memory = memory_;
  const Predictor last = last_;
  Course course = course_of(state, column);
  double length = 0.5;
  bool grows = false;
  while (course.load < 1.0 && length >= shortest_part && !stopped_) {
    Column next = column;
    Course on = course;
    load(on, next, std::min(length, 1.0 - course.load));
    evaluate(next);
    last_.slopes = system_.slopes(column.index, memory_, last_.jump, own_);
    const bool found = attempt(next, tolerance, {&last_, false}, steps);
    if (found) {
      course = on;
      column = next;
      memory_ = after(column);
      last_ = {column.force(), column.jump, {}};
    }
    length *= !found ? smaller_by : grows ? 1.0 / smaller_by : 1.0;
    grows = found;
  }
  memory_ = memory;
  last_ = last;
  // to the laws all that is one step
  evaluate(column);
  return course.load == 1.0 && (attempt(column, tolerance, {}, steps) ||
                                attempt(column, tolerance, {nullptr, true}, steps));
}

bool Newton::follow(const State& state, Column& column, double tolerance, Index& steps) {
  const JoinedSystem::Memory memory = memory_;
  Course course = course_of(state, column);
  torn_ = false;
  intact_ = stiffness_of_bonds(column.index);
  // where the loads of the step before are still on
  bool goes_on = column.norm <= rounding_of_forces * scale_ ||
                 attempt(column, tolerance, {&last_, false}, steps);
  double least = 0.0;
  double peak = 0.0;
  for (Index part = 0; part < most_parts && goes_on && course.load != 1.0; ++part) {
    // bonds that were at their strength may be unloaded by this step: what damages none comes first
    const bool strong = at_strength(course, column);
    if (!strong || part == 0) {
      goes_on = go_elastic(course, column, tolerance, steps);
      if (goes_on || !strong) {
        continue;
      }
      goes_on = !stopped_;
      torn_ = false;
    }
    if (energy_ == 0.0) {
      energy_ = system_.follow_first(
          0.5 * softening_.cwiseProduct(column.force()).cwiseProduct(opening(column)).maxCoeff());
    }
    least = std::max(least, least_share * energy_);
    energy_ *= advance(course, column, tolerance, steps);
    goes_on = energy_ > least && !stopped_;
    peak = std::max(peak, course.load);
    if (peak > 0.0) {  // what only unloads does not snap, nor does a load that turns by passing 0
      const double most =
          std::max(course.before.norm(), (course.before + peak * course.change).norm());
      fall_ = std::max(fall_, (peak - course.load) * course.change.norm() / most);
    }
  }
  if (torn_) {  // what has come off slides away, or comes to rest
    load(course, column, 1.0 - course.load);
    evaluate(column);
    course.load = drift(column, tolerance, steps) ? 1.0 : 0.0;
  }
  const bool damaged = system_.damages(memory, memory_);
  memory_ = memory;
  energy_ = course.load == 1.0 ? energy_ : 0.0;
  // what was damaged on the way is one step to the laws
  evaluate(column);
  return course.load == 1.0 && (!damaged || attempt(column, tolerance, {}, steps));
}

/// Free jumps if bonds open a little more, but for those that the course closes.
Vector Newton::opened_on(const Course& course, const Column& column) const {
  const Vector jump = opening(column);
  Vector more = onwards * softening_.cwiseSign().cwiseProduct(jump);
  for (Index row = 0; row < more.size() && course.opens.size() > 0; ++row) {
    const auto point = static_cast<std::size_t>(row);
    const auto at = Eigen::seqN(system_.layout().first[point], system_.layout().components[point]);
    if (jump(at).dot(course.opens(at)) < 0.0) {
      more(row) = -more(row);
    }
  }
  return column.jump + more;
}

/// Whether that damages any.
bool Newton::at_strength(const Course& course, const Column& column) const {
  JoinedSystem::Memory memory = memory_;
  system_.advance(column.index, memory, opened_on(course, column), own_);
  return system_.damages(memory_, memory);
}

/// (unknowns) of bonds that nothing has damaged.
Vector Newton::stiffness_of_bonds(Index index) const {
  const Matrix slopes = system_.slopes(index, system_.blank(), Vector::Zero(own_.size()), own_);
  Vector stiffness(own_.size());
  for (Index row = 0; row < own_.size(); ++row) {
    const double slope = slopes(row, row - system_.layout().first[static_cast<std::size_t>(row)]);
    stiffness(row) = softening_(row) > 0.0 ? slope / (1.0 - slope * own_(row)) : 0.0;
  }
  return stiffness;
}

/// 1 - D of the points of bonds, in the first row of each; 1 elsewhere.
Vector Newton::integrity(const Column& column) const {
  const Vector force = column.force();
  const Vector jump = opening(column);
  Vector left = Vector::Ones(own_.size());
  for (Index row = 0; row < own_.size(); ++row) {
    const Index first = system_.layout().first[static_cast<std::size_t>(row)];
    const Index count = system_.layout().components[static_cast<std::size_t>(row)];
    const auto at = Eigen::seqN(first, count);
    const double whole = intact_(at).dot(jump(at).cwiseAbs2());
    if (row == first && whole > 0.0) {
      left(row) = std::clamp(force(at).dot(jump(at)) / whole, 0.0, 1.0);
    }
  }
  return left;
}

/// Points that are damaged in an increment, relative to what is meant.
double Newton::damage(const Column& from, const Column& to) const {
  const Vector lost = (integrity(from) - integrity(to)).cwiseMax(0.0);
  const Vector before = softening_.cwiseProduct(opening(from));
  // bonds go on as they did: with the loads the other way round as much might be dissipated
  if (system_.follow_first(before.dot(opening(to))) < 0.0) {
    return std::numeric_limits<double>::infinity();
  }
  const auto points = static_cast<double>((lost.array() > damaged_by).count());
  return system_.follow_first(lost.sum() / std::max(1.0, share_of_damaged * points));
}

/// By one increment, or to the load of the step if that lies on the way.
/// @return by how much the next one may be larger, or has to be smaller
double Newton::advance(Course& course, Column& column, double tolerance, Index& steps) {
  Course on = course;
  Column next = column;
  if (!dissipate(on, next, energy_, tolerance, steps)) {
    return smaller_by;
  }
  const double damaged = damage(column, next);
  if (damaged >= exceeded) {
    return smaller_by;
  }
  // on the way the load changes no faster than at the ends
  const double most = 0.5 * (course.load + on.load +
                             energy_ * std::max(std::abs(on.rate_at_first), std::abs(on.rate)));
  if (most >= 1.0 && !arrive(course, column, on, next, tolerance, steps) && on.load > 1.0) {
    return smaller_by;
  }
  course = on;
  course.opens = opening(next) - opening(column);
  column = next;
  memory_ = after(column);
  return damaged > 0.0 ? std::min(largest_growth, 1.0 / damaged) : largest_growth;
}

/// Looks for the load of the step between two states of the path: less is damaged there than at the later one.
/// @param on, next the later one; the place on the way if there is one
bool Newton::arrive(const Course& course, const Column& column, Course& on, Column& next,
                    double tolerance, Index& steps) {
  const double left = 1.0 - course.load;
  const double rise = on.load > 1.0 ? on.load - course.load : energy_ * on.rate_at_first;
  const double share = rise > left ? left / rise : 0.5;
  Course there = course;
  Column between = column;
  load(there, between, left);
  there.load = 1.0;
  between.y += share * (next.y - column.y);
  between.motion += share * (next.motion - column.motion);
  between.jump += share * (next.jump - column.jump - (on.load - course.load) * course.jump);
  evaluate(between);
  const bool found = attempt(between, tolerance, {}, steps) &&
                     system_.follow_first(
                         (integrity(next) - integrity(between)).maxCoeff<keep_nan>()) < of_a_point;
  if (found) {
    on = there;
    next = between;
  }
  return found;
}

/// Until a point is at its strength, where contacts stay as they are.
/// @return whether the load has grown
bool Newton::go_elastic(Course& course, Column& column, double tolerance, Index& steps) {
  const Predictor unloading{column.force(), column.jump, slopes(column)};
  const double left = 1.0 - course.load;
  Vector dy;
  Vector dm;
  if (stopped_) {
    return false;
  }
  try {
    torn_ = !skeleton_->step(unloading.slopes,
                             times(unloading.slopes, system_.layout().first,
                                   system_.layout().components, left * course.jump),
                             left * course.start.loads, dy, dm) ||
            skeleton_->loose(dm, scale_);
  } catch (const NumericalError&) {
    torn_ = true;  // the matrix is singular
  }
  torn_ = system_.follow_first(torn_);
  if (torn_) {
    return false;
  }
  ++steps;
  const Vector change = skeleton_->moved(dy, dm);
  course.opens = change + left * course.jump - own_.cwiseProduct(dy);
  const auto at = [&](double share) {
    Column there = column;
    Course on = course;
    load(on, there, share * left);
    there.y += share * dy;
    there.motion += share * dm;
    there.jump += share * change;
    return there;
  };
  const auto damages = [&](double share) { return system_.damages(memory_, after(at(share))); };
  double share = 1.0;
  if (damages(1.0)) {
    double low = 0.0;
    double high = 1.0;
    while (high - low > of_load) {
      const double middle = 0.5 * (low + high);
      (damages(middle) ? high : low) = middle;
    }
    share = low;
  }
  for (; share > of_load; share *= smaller_by) {
    Column there = at(share);
    evaluate(there);
    if (attempt(there, tolerance, {}, steps)) {
      course.load = share == 1.0 ? 1.0 : course.load + share * left;
      column = there;
      memory_ = after(column);
      return true;
    }
  }
  return false;
}

/// Areas of the unknowns of bonds, without normals under pressure: that damages nothing.
Vector Newton::tension(const Column& column) const {
  const Vector jump = opening(column);
  Vector areas = softening_;
  for (Index row = 0; row < areas.size(); ++row) {
    if (system_.layout().first[static_cast<std::size_t>(row)] == row && jump(row) < 0.0) {
      areas(row) = 0.0;
    }
  }
  return areas;
}

bool Newton::dissipate(Course& course, Column& column, double amount, double tolerance,
                       Index& steps) {
  const auto& layout = system_.layout();
  Vector counts = tension(column);
  const Vector force = counts.cwiseProduct(column.force());
  const Vector jump = counts.cwiseProduct(opening(column));
  // half of f0 j - f j0: the energy that secants lose
  const auto dissipated = [&](const Vector& y, const Vector& free) {
    const Vector moved = free - own_.cwiseProduct(y);
    return 0.5 * (force.dot(counts.cwiseProduct(moved)) - jump.dot(counts.cwiseProduct(y)));
  };
  const double size = std::max(scale_, skeleton_->size_of(column.force()));
  Matrix tangent = system_.slopes(column.index, memory_, opened_on(course, column), own_);
  skeleton_->exactly(true);
  for (Index count = 0; count < most_corrections; ++count) {
    counts = tension(column).cwiseSign();
    const double value = system_.follow_first(dissipated(column.force(), column.jump) - amount);
    if (count > 0) {
      if (!std::isfinite(column.norm)) {
        return false;
      }
      if (column.norm <= tolerance * size && std::abs(value) <= accuracy_of_amount * amount) {
        return true;
      }
      tangent = slopes(column);
    }
    stopped_ = stopped_ || (goes_on_ && !goes_on_(steps));
    Vector dy;
    Vector dm;
    Vector dy_of_load;
    Vector dm_of_load;
    if (stopped_ || !skeleton_->step(tangent, column.phi, imbalance(column), dy, dm) ||
        !skeleton_->step(tangent, times(tangent, layout.first, layout.components, course.jump),
                         course.start.loads, dy_of_load, dm_of_load)) {
      return false;
    }
    ++steps;
    const Vector change = skeleton_->moved(dy, dm);
    const Vector change_of_load = skeleton_->moved(dy_of_load, dm_of_load) + course.jump;
    const double rate = dissipated(dy_of_load, change_of_load);
    course.rate = system_.follow_first(1.0 / rate);
    if (count == 0) {
      course.rate_at_first = course.rate;
    }
    const double more = system_.follow_first(-(value + dissipated(dy, change)) / rate);
    if (!std::isfinite(more)) {
      return false;
    }
    column.y += dy + more * dy_of_load;
    column.motion += dm + more * dm_of_load;
    column.jump += change + more * (change_of_load - course.jump);
    load(course, column, more);
    evaluate(column);
  }
  return false;
}

}  // namespace latin::iteration
