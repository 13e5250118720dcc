#include "latin/iteration/linearisation.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace latin::iteration {
namespace {

using substructure::Tangent;

/// Columns that may each have a linearisation of their own.
constexpr std::size_t most_tangents = 16;
/// Tangents whose stiffnesses differ by no more than this factor are near.
constexpr double near_factor = 10.0;
/// Slopes below this, relative to the stiffest possible, count as none.
constexpr double no_slope = 1e-9;

/// Whether slopes are the same to rounding of differences.
bool alike(const Matrix& a, const Matrix& b) {
  constexpr double same = 1e-6;
  return a.size() == b.size() &&
         (a - b).cwiseAbs().maxCoeff() <= same * std::max(a.cwiseAbs().maxCoeff(), 1e-300);
}

/// Whether two stiffnesses, given as s / (1 + s) each, are alike to `near_factor`.
bool comparable(double a, double b) {
  const double one = std::abs(a) / std::max(1.0 - std::abs(a), no_slope) + no_slope;
  const double two = std::abs(b) / std::max(1.0 - std::abs(b), no_slope) + no_slope;
  return one <= near_factor * two && two <= near_factor * one;
}

}  // namespace

Linearisation::Slopes Linearisation::slopes_of(const substructure::Laws& laws, const State& state) {
  const Index columns = state.data.cols();
  // of a chaos, the mean stands for all modes of a step
  const Index own = laws.modes() > 1 ? laws.steps() : columns;
  const Matrix jumps = Tangent::free_jumps(laws.structure(), state.data.leftCols(own),
                                           state.traces.leftCols(own));
  Slopes slopes;
  for (Matrix& now : Tangent::slopes(laws, jumps)) {
    std::size_t at = 0;
    while (at < slopes.distinct.size() && !alike(slopes.distinct[at], now)) {
      ++at;
    }
    if (at == slopes.distinct.size()) {
      if (at == most_tangents) {
        at = most_tangents - 1;
      } else {
        slopes.distinct.push_back(std::move(now));
      }
    }
    slopes.of_column.push_back(at);
  }
  return slopes;
}

bool Linearisation::take(const substructure::Laws& laws, const State& state, double hold) {
  Slopes now = slopes_of(laws, state);
  bool changed = now.distinct.size() != slopes_.size() || hold != hold_;
  for (std::size_t i = 0; i < now.distinct.size() && !changed; ++i) {
    changed = !alike(now.distinct[i], slopes_[i]);
  }
  of_column_ = std::move(now.of_column);
  if (changed) {
    slopes_.clear();  // if a factorisation fails there are none
    tangents_.resize(now.distinct.size());
    for (std::size_t i = 0; i < now.distinct.size(); ++i) {
      if (!tangents_[i]) {
        tangents_[i] = std::make_unique<Tangent>(laws.structure());
      }
      tangents_[i]->factorise(now.distinct[i], hold);
    }
    slopes_ = std::move(now.distinct);
    hold_ = hold;
  }
  return changed;
}

bool Linearisation::near(const substructure::Laws& laws, const State& state) const {
  const auto own = of_column_.size();
  const Vector& flexibility = tangents_.front()->flexibility();
  const Slopes now = slopes_of(laws, state);
  for (std::size_t column = 0; column < now.of_column.size(); ++column) {
    const Matrix& a = now.distinct[now.of_column[column]];
    const Matrix& b = slopes_[of_column_[column % own]];
    for (Index row = 0; row < a.rows(); ++row) {
      // the stiffness of a point in its own direction
      const Index component = tangents_.front()->component(row);
      const double c = flexibility(row);
      if (!comparable(c * a(row, component), c * b(row, component))) {
        return false;
      }
    }
  }
  return true;
}

void Linearisation::correct(MatrixRef residual, Matrix& moved) const {
  moved.resize(residual.rows(), residual.cols());
  if (tangents_.size() == 1) {
    tangents_.front()->correct(residual, moved);
    return;
  }
  const auto own = of_column_.size();
  for (std::size_t i = 0; i < tangents_.size(); ++i) {
    std::vector<Index> columns;
    for (Index column = 0; column < residual.cols(); ++column) {
      if (of_column_[static_cast<std::size_t>(column) % own] == i) {
        columns.push_back(column);
      }
    }
    Matrix block = residual(every, columns);
    Matrix change(block.rows(), block.cols());
    tangents_[i]->correct(block, change);
    residual(every, columns) = block;
    moved(every, columns) = change;
  }
}

}  // namespace latin::iteration
