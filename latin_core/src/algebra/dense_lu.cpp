#include "latin/algebra/dense_lu.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cstddef>
#include <utility>

#include "latin/algebra/lapack.hpp"
#include "latin/common/threads.hpp"

namespace latin::algebra {
namespace {

/// Columns that are eliminated together, and that one thread brings up to date at a time.
constexpr Index panel_width = 96;
/// Operations that take as long as reading a number.
constexpr double operations_per_number = 16.0;

}  // namespace

Matrix DenseLU::release() { return std::exchange(factors_, Matrix()); }

void DenseLU::factorise(Matrix matrix) {
  const SerialAlgebra serial;
  factors_ = std::move(matrix);
  const Index size = factors_.rows();
  pivots_.assign(static_cast<std::size_t>(size), 0);
  if (size == 0) {
    return;
  }
  factorise_panel(0);
  for (Index panel = 0; panel + panel_width < size; panel += panel_width) {
    // the next panel first: it is factorised while the other columns are brought up to date
    const Index rest = size - panel - panel_width;
    const auto operations = 2.0 * static_cast<double>(rest * rest * panel_width);
    in_lanes(static_cast<std::size_t>((rest + panel_width - 1) / panel_width),
             operations / operations_per_number, [&](std::size_t piece) {
               const Index column = panel + panel_width * (1 + static_cast<Index>(piece));
               update(panel, column, std::min(panel_width, size - column));
               if (piece == 0) {
                 factorise_panel(column);
               }
             });
  }
  // rows of L are exchanged as later panels say
  in_lanes(static_cast<std::size_t>((size + panel_width - 1) / panel_width),
           static_cast<double>(size * size), [&](std::size_t piece) {
             const Index column = panel_width * static_cast<Index>(piece);
             for (Index panel = column + panel_width; panel < size; panel += panel_width) {
               exchange(panel, column, std::min(panel_width, size - column));
             }
           });
}

void DenseLU::factorise_panel(Index first) {
  const int rows = static_cast<int>(factors_.rows() - first);
  const int columns = std::min(static_cast<int>(panel_width), rows);
  const int stride = static_cast<int>(factors_.rows());
  int info = 0;  // a pivot of zero makes answers that are not finite
  dgetrf_(&rows, &columns, &factors_(first, first), &stride,
          &pivots_[static_cast<std::size_t>(first)], &info);
}

void DenseLU::exchange(Index panel, Index column, Index columns) {
  const Index last = std::min(panel + panel_width, factors_.rows());
  for (Index at = column; at < column + columns; ++at) {
    double* of_column = &factors_(0, at);
    for (Index row = panel; row < last; ++row) {
      std::swap(of_column[row], of_column[panel + pivots_[static_cast<std::size_t>(row)] - 1]);
    }
  }
}

void DenseLU::update(Index panel, Index column, Index columns) {
  exchange(panel, column, columns);
  const Index below = factors_.rows() - panel - panel_width;
  auto top = factors_.block(panel, column, panel_width, columns);
  factors_.block(panel, panel, panel_width, panel_width)
      .triangularView<Eigen::UnitLower>()
      .solveInPlace(top);
  factors_.block(panel + panel_width, column, below, columns).noalias() -=
      factors_.block(panel + panel_width, panel, below, panel_width) * top;
}

Vector DenseLU::solve_transposed(ConstVectorRef right) const {
  Vector answer = right;
  if (size() == 0) {
    return answer;
  }
  factors_.triangularView<Eigen::Upper>().transpose().solveInPlace(answer);
  factors_.triangularView<Eigen::UnitLower>().transpose().solveInPlace(answer);
  for (Index row = size() - 1; row >= 0; --row) {
    const Index panel = row - row % panel_width;
    std::swap(answer(row), answer(panel + pivots_[static_cast<std::size_t>(row)] - 1));
  }
  return answer;
}

}  // namespace latin::algebra
