#include "algebra/dense_lu.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cstddef>

#include "algebra/lapack.hpp"
#include "common/threads.hpp"

namespace latin::algebra {
namespace {

/// Columns that are eliminated together, and that one thread brings up to date at a time.
constexpr Index panel_width = 96;
/// Operations that take as long as reading a number.
constexpr double operations_per_number = 16.0;
/// Unknowns of a solution that one thread finds, and of which every piece finds what those before do to some.
constexpr Index solved_together = 256;
constexpr Index of_one_piece = 32;

}  // namespace

Eigen::Map<Matrix> DenseLU::matrix(Index size) {
  size_ = size;
  if (numbers_.size() < size * size) {
    numbers_.resize(size * size);
  }
  return {numbers_.data(), size, size};
}

void DenseLU::factorise() {
  const SerialAlgebra serial;
  const Index size = size_;
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
  const int rows = static_cast<int>(size_ - first);
  const int columns = std::min(static_cast<int>(panel_width), rows);
  const int stride = static_cast<int>(size_);
  int info = 0;  // a pivot of zero makes answers that are not finite
  dgetrf_(&rows, &columns, &numbers_(first * size_ + first), &stride,
          &pivots_[static_cast<std::size_t>(first)], &info);
}

void DenseLU::exchange(Index panel, Index column, Index columns) {
  const Index last = std::min(panel + panel_width, size_);
  for (Index at = column; at < column + columns; ++at) {
    double* of_column = &numbers_(at * size_);
    for (Index row = panel; row < last; ++row) {
      std::swap(of_column[row], of_column[panel + pivots_[static_cast<std::size_t>(row)] - 1]);
    }
  }
}

void DenseLU::update(Index panel, Index column, Index columns) {
  exchange(panel, column, columns);
  Eigen::Map<Matrix> factors(numbers_.data(), size_, size_);
  const Index below = size_ - panel - panel_width;
  auto top = factors.block(panel, column, panel_width, columns);
  factors.block(panel, panel, panel_width, panel_width)
      .triangularView<Eigen::UnitLower>()
      .solveInPlace(top);
  factors.block(panel + panel_width, column, below, columns).noalias() -=
      factors.block(panel + panel_width, panel, below, panel_width) * top;
}

Vector DenseLU::solve_transposed(ConstVectorRef right) const {
  const SerialAlgebra serial;
  const auto numbers = factors();
  Vector answer = right;
  // U^T from the first unknowns on, then L^T from the last ones on: columns of U and L are read once
  for (Index first = 0; first < size_; first += solved_together) {
    const Index count = std::min(solved_together, size_ - first);
    in_pieces(count, of_one_piece, first, [&](Index begin, Index columns) {
      answer.segment(first + begin, columns).noalias() -=
          numbers.block(0, first + begin, first, columns).transpose() * answer.head(first);
    });
    auto part = answer.segment(first, count);
    numbers.block(first, first, count, count)
        .triangularView<Eigen::Upper>()
        .transpose()
        .solveInPlace(part);
  }
  for (Index first = (size_ - 1) / solved_together * solved_together; first >= 0;
       first -= solved_together) {
    const Index count = std::min(solved_together, size_ - first);
    const Index end = first + count;
    in_pieces(count, of_one_piece, size_ - end, [&](Index begin, Index columns) {
      answer.segment(first + begin, columns).noalias() -=
          numbers.block(end, first + begin, size_ - end, columns).transpose() *
          answer.tail(size_ - end);
    });
    auto part = answer.segment(first, count);
    numbers.block(first, first, count, count)
        .triangularView<Eigen::UnitLower>()
        .transpose()
        .solveInPlace(part);
  }
  for (Index row = size() - 1; row >= 0; --row) {
    const Index panel = row - row % panel_width;
    std::swap(answer(row), answer(panel + pivots_[static_cast<std::size_t>(row)] - 1));
  }
  return answer;
}

}  // namespace latin::algebra
