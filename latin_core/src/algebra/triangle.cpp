#include "latin/algebra/triangle.hpp"

#include <algorithm>

namespace latin::algebra {
namespace {

constexpr Index few_columns = 3;
/// Columns and rows of a piece of the triangle: 1 MB, which stays in a cache for the next column of x.
constexpr Index piece_columns = 64;
constexpr Index piece_rows = 2048;

/// Calls `visit(first row, rows)` of the pieces below a row.
template <class Visit>
void pieces_below(Index row, Index rows, const Visit& visit) {
  for (; row < rows; row += piece_rows) {
    visit(row, std::min(piece_rows, rows - row));
  }
}

}  // namespace

void solve_with_triangle(ConstMatrixRef lower, MatrixRef x) {
  if (x.cols() > few_columns) {
    lower.triangularView<Eigen::Lower>().solveInPlace(x);
    lower.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
    return;
  }
  const Index size = lower.rows();
  for (Index j = 0; j < size; j += piece_columns) {
    const Index count = std::min(piece_columns, size - j);
    const auto diagonal = lower.block(j, j, count, count).triangularView<Eigen::Lower>();
    for (Index c = 0; c < x.cols(); ++c) {
      auto part = x.col(c).segment(j, count);
      diagonal.solveInPlace(part);
    }
    pieces_below(j + count, size, [&](Index row, Index rows) {
      for (Index c = 0; c < x.cols(); ++c) {
        x.col(c).segment(row, rows).noalias() -=
            lower.block(row, j, rows, count) * x.col(c).segment(j, count);
      }
    });
  }
  for (Index j = (size - 1) / piece_columns * piece_columns; j >= 0; j -= piece_columns) {
    const Index count = std::min(piece_columns, size - j);
    pieces_below(j + count, size, [&](Index row, Index rows) {
      for (Index c = 0; c < x.cols(); ++c) {
        x.col(c).segment(j, count).noalias() -=
            lower.block(row, j, rows, count).transpose() * x.col(c).segment(row, rows);
      }
    });
    const auto diagonal = lower.block(j, j, count, count);
    for (Index c = 0; c < x.cols(); ++c) {
      auto part = x.col(c).segment(j, count);
      diagonal.transpose().triangularView<Eigen::Upper>().solveInPlace(part);
    }
  }
}

}  // namespace latin::algebra
