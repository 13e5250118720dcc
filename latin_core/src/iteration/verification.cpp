#include "latin/iteration/verification.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "latin/common/error.hpp"

namespace latin::iteration {
namespace {

using substructure::Tangent;

/// Steps at most, and how many of them the next is combined with.
constexpr Index most_steps = 12;
constexpr Index depth = 8;
/// A step below this fraction of the way so far leaves the error known, if it is that much shorter than the last.
constexpr double shorter = 0.25;
constexpr double contraction = 0.5;
/// A step that is no shorter than the last may be this fraction of what is left.
constexpr double most_left = 20.0;
/// Errors below this fraction of the tolerance need not be known any better.
constexpr double negligible = 0.05;
/// Columns that may each have a linearisation of their own.
constexpr std::size_t most_tangents = 16;
/// Time steps of a history with memory, each of which has tangents of its own.
constexpr Index most_steps_of_history = 16;
/// Steps of a search, and plain steps where those do not help.
constexpr Index most_of_search = 200;
constexpr Index first_pause = 4;
/// A residual of a search may grow by this: it does where a part begins to move.
constexpr double bearable_growth = 1.2;
/// Springs that hold the bodies, relative to the search direction.
constexpr double largest_hold = 25.0;
constexpr double least_hold = 1e-11;
/// Rounding of a force, relative to the terms that it is the balance of: of many inside the bodies.
constexpr double rounding = 1e-15;

/// Whether slopes are the same to rounding of differences.
bool alike(const Matrix& a, const Matrix& b) {
  constexpr double same = 1e-6;
  return a.size() == b.size() &&
         (a - b).cwiseAbs().maxCoeff() <= same * std::max(a.cwiseAbs().maxCoeff(), 1e-300);
}

}  // namespace

bool Verification::possible(const substructure::Laws& laws) {
  if (!Tangent::possible(laws.structure())) {
    return false;
  }
  return laws.steps() <= most_steps_of_history || !laws.remembers();
}

Verification::Verification(Stages& stages)
    : stages_(stages),
      gauge_(gauge_of(stages.structure(), stages.laws().groups())),
      history_(metric_of(stages.structure()), stages.amplitudes().cols(), depth) {}

/// The column whose slopes stand for those of a column: of a chaos, the mean's in the same step.
Index Verification::column_of(Index column) const {
  const substructure::ColumnGroups groups = stages_.laws().groups();
  return groups.modes > 1 ? column % groups.steps : column;
}

/// Take the tangents of where we are. @return whether they have changed
bool Verification::linearise(double hold) {
  const substructure::Laws& laws = stages_.laws();
  const Index columns = better_.data.cols();
  const bool chaos = laws.modes() > 1;
  const Index own = chaos ? laws.steps() : columns;
  const Matrix jumps = Tangent::free_jumps(laws.structure(), better_.data.leftCols(own),
                                           better_.traces.leftCols(own));
  std::vector<Matrix> slopes;
  std::vector<std::size_t> of_column;
  for (Index column = 0; column < own; ++column) {
    Matrix now = Tangent::slopes(laws, jumps, column);
    std::size_t at = 0;
    while (at < slopes.size() && !alike(slopes[at], now)) {
      ++at;
    }
    if (at == slopes.size()) {
      if (at == most_tangents) {
        at = most_tangents - 1;
      } else {
        slopes.push_back(std::move(now));
      }
    }
    of_column.push_back(at);
  }
  bool changed = slopes.size() != slopes_.size() || hold != hold_;
  for (std::size_t i = 0; i < slopes.size() && !changed; ++i) {
    changed = !alike(slopes[i], slopes_[i]);
  }
  tangent_of_.assign(static_cast<std::size_t>(columns), 0);
  for (Index column = 0; column < columns; ++column) {
    tangent_of_[static_cast<std::size_t>(column)] =
        of_column[static_cast<std::size_t>(column_of(column))];
  }
  if (changed) {
    slopes_.clear();  // if a factorisation fails there are none
    tangents_.resize(slopes.size());
    for (std::size_t i = 0; i < slopes.size(); ++i) {
      if (!tangents_[i]) {
        tangents_[i] = std::make_unique<Tangent>(laws.structure());
      }
      tangents_[i]->factorise(slopes[i], hold);
    }
    slopes_ = std::move(slopes);
    hold_ = hold;
  }
  return changed;
}

/// Residual into step, with what that does to the traces in `moved_`.
void Verification::correct(MatrixRef residual) {
  moved_.resize(residual.rows(), residual.cols());
  if (tangents_.size() == 1) {
    tangents_.front()->correct(residual, moved_);
    return;
  }
  for (std::size_t i = 0; i < tangents_.size(); ++i) {
    std::vector<Index> columns;
    for (std::size_t column = 0; column < tangent_of_.size(); ++column) {
      if (tangent_of_[column] == i) {
        columns.push_back(static_cast<Index>(column));
      }
    }
    Matrix own = residual(every, columns);
    Matrix moved(own.rows(), own.cols());
    tangents_[i]->correct(own, moved);
    residual(every, columns) = own;
    moved_(every, columns) = moved;
  }
}

/// Both stages. @return whether the laws have an answer there: too far off they may have none
bool Verification::evaluate(State& state, Matrix& residual) {
  try {
    stages_.evaluate({state, residual});
  } catch (const NumericalError&) {
    return false;
  }
  return residual.allFinite();
}

/// Errors of steps with those that laws with memory carry over from the steps before.
Matrix Verification::carried(Matrix errors) const {
  const substructure::ColumnGroups groups = stages_.laws().groups();
  if (!stages_.laws().remembers()) {
    return errors;
  }
  const Index block = groups.steps * groups.kinds();
  for (Index group = groups.kinds(); group < errors.rows(); ++group) {
    if (group % block >= groups.kinds()) {
      errors.row(group) += errors.row(group - groups.kinds());
    }
  }
  return errors;
}

/// What rounding of forces and displacements may do to the answer, by the same tangents.
Matrix Verification::rounding_errors(const Whole& whole) {
  const Vector& directions = stages_.structure().directions();
  Matrix noise = better_.data.cwiseAbs() + directions.asDiagonal() * better_.traces.cwiseAbs();
  for (Index column = 0; column < noise.cols(); ++column) {
    for (Index row = 0; row < noise.rows(); ++row) {
      // any fixed signs without a pattern
      noise(row, column) *= rounding * std::copysign(1.0, std::sin(1.7 * static_cast<double>((row + 1) * (column + 3))));
    }
  }
  correct(noise);
  return whole.relative(gauge_.of_difference(noise, moved_));
}

std::optional<Verification::Found> Verification::check(const State& state, const Matrix& residual,
                                                       const Whole& whole, double rtol) {
  better_ = state;
  residual_ = residual;
  history_.clear();
  distance_.resize(0, 0);
  Matrix step(residual.rows(), residual.cols());
  Matrix before;
  const double least = negligible * rtol;
  double first = 0.0;
  const double noise = 10.0 * rounding_share * history_.metric().norm(state.data);
  for (Index count = 0; count <= most_steps; ++count) {
    try {
      if (linearise(least_hold)) {
        history_.clear();
      }
    } catch (const NumericalError&) {
      return std::nullopt;  // not stable: its error is anything
    }
    history_.fit(residual_);
    history_.step(residual_, 1.0, [this](MatrixRef block) { correct(block); }, step);
    if (count == 0) {
      first = history_.residual_norm();
    }
    if (!step.allFinite()) {
      return std::nullopt;
    }
    if (history_.size() > 0) {
      moved_ -= history_.predicted_error().traces;
    }
    const Matrix ahead = whole.relative(gauge_.of_difference(step, moved_));
    if (count > 0) {
      distance_ = whole.relative(gauge_.of_distance(better_, state));
      // how much of an error a step leaves, as far as the last two of them say
      const Matrix left = (before.array() > 0.0)
                              .select(ahead.cwiseQuotient(before), 0.0)
                              .cwiseMin(1.0 - 1.0 / most_left);
      const Matrix rest = carried((ahead.array() / (1.0 - left.array())).matrix());
      const auto enough =
          (rest.array() <= least) ||
          ((ahead.array() <= shorter * distance_.array()) && (left.array() <= contraction));
      if (enough.all() && history_.residual_norm() <= std::max(first, noise)) {
        return Found{distance_ + ahead, rest.cwiseMax(rounding_errors(whole))};
      }
    }
    before = ahead;
    const State from = better_;
    const Matrix residual_before = residual_;
    better_.data += step;
    if (!evaluate(better_, residual_)) {
      return std::nullopt;
    }
    history_.push(better_.data - from.data, residual_ - residual_before,
                  better_.traces - from.traces);
  }
  return std::nullopt;
}

/// A step with bodies held by springs of that fraction of k. @return whether it is one to go on from
bool Verification::held_step(double hold, double& norm) {
  Matrix step = residual_;
  try {
    linearise(hold);
    correct(step);
  } catch (const NumericalError&) {
    return false;
  }
  if (!step.allFinite()) {
    return false;
  }
  State trial{better_.data + step, Matrix(step.rows(), step.cols())};
  Matrix residual(step.rows(), step.cols());
  if (!evaluate(trial, residual)) {
    return false;
  }
  const double now = history_.metric().norm(residual);
  if (!(now <= bearable_growth * norm)) {
    return false;
  }
  better_ = std::move(trial);
  residual_ = std::move(residual);
  norm = now;
  return true;
}

/// Averaged steps, which come nearer to the answer of every monotone law.
void Verification::plain_steps(Index count, double& norm) {
  for (Index i = 0; i < count; ++i) {
    better_.data += averaged_share * residual_;
    if (!evaluate(better_, residual_)) {
      norm = std::numeric_limits<double>::infinity();
      return;
    }
  }
  norm = history_.metric().norm(residual_);
}

bool Verification::search(const State& state, const Matrix& residual, double least) {
  const double first = history_.metric().norm(residual);
  Best best{state, residual, first};
  for (const double patience : {0.3, 0.5}) {
    if (best.norm > least) {
      better_ = state;
      residual_ = residual;
      search_once(patience, least, best);
    }
  }
  better_ = std::move(best.state);
  residual_ = std::move(best.residual);
  return best.norm < first;
}

/// @param patience how much less the bodies are held after a step that did not make the residual fall
void Verification::search_once(double patience, double least, Best& best) {
  double norm = history_.metric().norm(residual_);
  double hold = 1.0;
  for (Index count = 0; count < most_of_search && norm > least && std::isfinite(norm); ++count) {
    const double before = norm;
    if (held_step(hold, norm)) {
      const double fall = norm / before;
      hold *= fall < 0.5 ? 0.05 : fall < 0.95 ? 0.3 : fall <= 1.0 + 1e-3 ? patience : 3.0 * patience;
      hold = std::clamp(hold, least_hold, largest_hold);
    } else if (hold < largest_hold) {
      hold = std::min(5.0 * hold, largest_hold);
    } else {
      plain_steps(first_pause, norm);
      hold = 1.0;
    }
    if (norm < best.norm) {
      best = {better_, residual_, norm};
    }
  }
}

}  // namespace latin::iteration
