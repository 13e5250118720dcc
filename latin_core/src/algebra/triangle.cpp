#include "algebra/triangle.hpp"

#include <algorithm>

#include "common/threads.hpp"

namespace latin::algebra {
namespace {

constexpr Index few_columns = 3;
/// Columns and rows of a piece of the triangle: 1 MB, which stays in a cache for the next column of x.
constexpr Index piece_columns = 64;
constexpr Index piece_rows = 2048;
/// Columns of a product that one thread multiplies, and rows that it reads at a time: 256 kB, which stay in its cache for
/// the second reading.
constexpr Index product_columns = 128;
constexpr Index product_rows = 256;

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

Vector product_with_triangle(ConstMatrixRef matrix, ConstVectorRef weights, ConstVectorRef y) {
  const Index size = matrix.rows();
  const Vector weighted = weights.cwiseProduct(y);
  Matrix of_pieces(size, (size + product_columns - 1) / product_columns);
  in_pieces(size, product_columns, size / 2, [&](Index first, Index count) {
    auto own = of_pieces.col(first / product_columns);
    Vector across = Vector::Zero(count);
    const auto part = y.segment(first, count);
    for (Index row = first + count; row < size; row += product_rows) {
      const Index rows = std::min(product_rows, size - row);
      const auto block = matrix.block(row, first, rows, count);
      own.segment(row, rows).noalias() = block * part;
      across.noalias() += block.transpose() * weighted.segment(row, rows);
    }
    own.segment(first, count).noalias() = matrix.block(first, first, count, count) * part;
    own.segment(first, count) += across.cwiseQuotient(weights.segment(first, count));
  });
  Vector result = Vector::Zero(size);
  for (Index piece = 0; piece < of_pieces.cols(); ++piece) {
    const Index rows = size - piece * product_columns;
    result.tail(rows) += of_pieces.col(piece).tail(rows);
  }
  return result;
}

}  // namespace latin::algebra
