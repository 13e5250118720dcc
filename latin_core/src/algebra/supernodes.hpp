#pragma once

#include <cstddef>
#include <cstdint>

namespace latin::algebra {

/// Columns of a lower triangle in the order of their elimination; the rows of a column in any order.
template <class Int>
struct LowerColumns {
  const Int* first;  ///< of every column, and one past the last
  const Int* rows;
  const double* values;
};

/// A supernodal factor: neighbouring columns with the same rows below them are one dense block, by columns.
template <class Int>
struct Supernodes {
  std::size_t size;         ///< columns
  std::size_t count;        ///< supernodes
  const Int* first_column;  ///< of every supernode, and one past the last
  const Int* first_row;     ///< its place in `rows`
  const Int* first_value;   ///< its place in `values`
  const Int* rows;          ///< ascending, the columns of the supernode first
  double* values;           ///< overwritten
};

/// A pivot was not positive.
struct NotPositive {
  std::size_t column;
};

/// Numbers of a Cholesky factor, on as many threads as the linear algebra has: subtrees of the elimination tree side by
/// side, then the supernodes above them one after the other, each by all threads. With one thread this is the order of
/// CHOLMOD.
/// @param matrix its pattern is in that of the factor
/// @param stop   columns to eliminate; those behind hold the lower triangle of the Schur complement on them
/// @throws NotPositive
void factorise_supernodes(const Supernodes<std::int32_t>& factor,
                          const LowerColumns<std::int32_t>& matrix, std::size_t stop);
void factorise_supernodes(const Supernodes<std::int64_t>& factor,
                          const LowerColumns<std::int64_t>& matrix, std::size_t stop);

}  // namespace latin::algebra
