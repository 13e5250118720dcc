#include <algorithm>
#include <cmath>
#include <utility>

#include "latin/iteration/newton.hpp"

namespace latin::iteration {
namespace {

/// Steps of Newton's with the load as an unknown, and increments of a column.
constexpr Index most_corrections = 10;
constexpr Index most_increments = 20000;
/// Increments grow by this once one has failed; one that fails is made smaller.
constexpr double growth_later = 1.05;
constexpr double smaller_by = 0.5;
/// The last that is tried, relative to the first.
constexpr double least_share = 1e-6;
/// Jumps are opened by this share to see what bonds at their threshold do when they are damaged.
constexpr double onwards = 1e-6;
/// A load is known to these digits.
constexpr double of_load = 1e-12;
constexpr double next_to_nothing = 1e-9;
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
          end.jump - column.jump};
}

bool Newton::follow(const State& state, Column& column, double tolerance, Index& steps) {
  const JoinedSystem::Memory memory = memory_;
  Course course = course_of(state, column);
  // where the loads of the step before are still on
  if ((system_.follow_first(column.norm) <= tolerance * scale_ ||
       attempt(column, tolerance, {&last_, false}, steps)) &&
      go_elastic(course, column, tolerance, steps)) {
    if (energy_ == 0.0) {
      energy_ = system_.follow_first(
          0.5 * softening_.cwiseProduct(column.force())
                    .cwiseProduct(column.jump - own_.cwiseProduct(column.force()))
                    .maxCoeff());
    }
    const double least = least_share * energy_;
    Index left = most_increments;
    while (course.load != 1.0 && energy_ > least && left-- > 0 && !stopped_) {
      if (advance(course, column, tolerance, steps)) {
        energy_ *= growth_;
      } else {
        growth_ = growth_later;
        energy_ *= smaller_by;
      }
    }
  }
  const bool damaged = system_.damages(memory, memory_);
  memory_ = memory;
  // what was damaged on the way is one step to the laws
  evaluate(column);
  return course.load == 1.0 && (!damaged || attempt(column, tolerance, {}, steps));
}

/// By one increment, or to the load of the step if that lies on the way.
bool Newton::advance(Course& course, Column& column, double tolerance, Index& steps) {
  Course on = course;
  Column next = column;
  bool found = dissipate(on, next, energy_, tolerance, steps);
  if (found && on.load > 1.0) {
    const double share = (1.0 - course.load) / (on.load - course.load);
    Column between = column;
    on = course;
    load(on, between, 1.0 - course.load);
    on.load = 1.0;
    between.y += share * (next.y - column.y);
    between.motion += share * (next.motion - column.motion);
    between.jump = column.jump + share * (next.jump - column.jump);
    next = between;
    evaluate(next);
    found = attempt(next, tolerance, {}, steps);
  }
  if (found) {
    course = on;
    column = next;
    memory_ = after(column);
  }
  return found;
}

bool Newton::go_elastic(Course& course, Column& column, double tolerance, Index& steps) {
  const Predictor unloading{column.force(), column.jump,
                            system_.slopes(column.index, memory_, column.jump, own_)};
  const double left = 1.0 - course.load;
  Vector dy;
  Vector dm;
  if (stopped_ || !skeleton_->step(unloading.slopes,
                                   times(unloading.slopes, system_.layout().first,
                                         system_.layout().components, left * course.jump),
                                   left * course.start.loads, dy, dm)) {
    return false;
  }
  ++steps;
  const Vector change = skeleton_->moved(dy, dm);
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
  for (; share > next_to_nothing; share *= smaller_by) {
    Column there = at(share);
    evaluate(there);
    if (attempt(there, tolerance, {}, steps)) {
      course.load = share == 1.0 ? 1.0 : course.load + share * left;
      column = there;
      memory_ = after(column);
      return true;
    }
  }
  return true;
}

bool Newton::dissipate(Course& course, Column& column, double amount, double tolerance,
                       Index& steps) {
  const auto& layout = system_.layout();
  const Vector force = softening_.cwiseProduct(column.force());
  const Vector opening = column.jump - own_.cwiseProduct(column.force());
  const Vector jump = softening_.cwiseProduct(opening);
  // half of f0 j - f j0: the energy that secants lose
  const auto dissipated = [&](const Vector& y, const Vector& free) {
    return 0.5 * (force.dot(free - own_.cwiseProduct(y)) - y.dot(jump));
  };
  const double size = std::max(scale_, skeleton_->size_of(column.force()));
  Matrix tangent =
      system_.slopes(column.index, memory_,
                     column.jump + onwards * softening_.cwiseSign().cwiseProduct(opening), own_);
  skeleton_->exactly(true);
  for (Index count = 0; count < most_corrections; ++count) {
    const double value = system_.follow_first(dissipated(column.force(), column.jump) - amount);
    if (count > 0) {
      if (!std::isfinite(column.norm)) {
        return false;
      }
      if (column.norm <= tolerance * size && std::abs(value) <= accuracy_of_amount * amount) {
        return true;
      }
      tangent = system_.slopes(column.index, memory_, column.jump, own_);
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
